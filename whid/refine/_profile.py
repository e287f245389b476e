"""The cost along one number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whid.errors import WhidError
from whid.record import Record
from whid.refine._free import FreeNumbers
from whid.refine._problem import Problem, data_of
from whid.signal import Floats
from whid.system import System


def profile(system: System, records: Sequence[Record], name: str, values: Floats, *, path: str = "exact") -> Floats:
    """Return Σ (y − ŷ)² with one number at each of some values and all others held; infinite where nothing simulates.

    >>> from whid.blocks.polynomial import Polynomial
    >>> line = System(chain=(Polynomial(coefficients=(0.0, 1.0)),))
    >>> profile(line, [Record(u=np.ones(4), y=np.full(4, 3.0), dt=1.0)], "chain.0.coefficients.1", np.array([1.0, 3.0]))
    array([16.,  0.])
    """
    data = data_of(records, system.tree)

    def cost(value: float) -> float:
        try:
            tree = system.tree.with_parameters({name: value})
        except WhidError:
            return float("inf")
        problem = Problem(FreeNumbers(tree, tuple(p.name for p in tree.parameters(held=True))), data, path)
        return problem.cost(problem.start)

    return np.array([cost(float(value)) for value in values])
