"""Score tests: what one more number would gain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from whid.record import Record
from whid.refine._free import FreeNumbers
from whid.refine._noise import with_noise
from whid.refine._problem import Problem, data_of
from whid.signal import Floats
from whid.system import System


def gains(system: System, records: Sequence[Record], extra: Sequence[str], *, path: str = "exact", fixed: Sequence[str] = (),
) -> Floats:  # fmt: skip
    """Return by how much each extra number alone, freed beside the others, would lower χ² (its score test, one degree).

    The system stands at its fit without the extra numbers. (Σ over the records, in units of the residual's variance.)
    """
    data = data_of(records, system.tree)
    problem = Problem(FreeNumbers(system.tree, tuple(fixed)), data, path)
    problem = with_noise(problem, problem.start, "white", robust=False)
    names = [p.name for p in problem.parameters]
    whole = problem.linearise(problem.start)
    base = np.array([name not in extra for name in names])

    def left(keep: NDArray[np.bool_]) -> float:
        return whole.columns(keep).rest

    return np.array([left(base) - left(base | (np.array(names) == name)) for name in extra])
