"""Record: what was measured. Identification sees Records and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from whid.experiments._part import Part, Use
from whid.signal import Floats

Intersample = Literal["zoh", "foh", "bandlimited", "discrete"]
Initial = Literal["rest", "steady", "free"]


@dataclass(frozen=True, eq=False)
class Record:
    """One uniformly sampled stretch of input and output; the state of a model restarts at each record.

    u, y        (N,) input and output, in `units`
    dt, t0      sampling time and time of the first sample, s
    valid       (N,) False where y is missing: a likelihood skips it, the state goes on
    intersample what the input does between samples: zoh, foh, bandlimited, discrete
    initial     the state before the first sample: rest, steady (at u[0]) or free
    parts       what happens when: holds, sines, …, by sample range
    use         what the whole record is for when it has no parts
    """

    u: Floats
    y: Floats
    dt: float
    t0: float = 0.0
    valid: NDArray[np.bool_] | None = None
    units: dict[str, str] = field(default_factory=lambda: {"input": "1", "output": "1"})
    intersample: Intersample = "zoh"
    initial: Initial = "rest"
    parts: tuple[Part, ...] = ()
    name: str = "record"
    use: Use = "estimation"

    def __len__(self) -> int:
        return len(self.u)

    @property
    def time(self) -> Floats:
        """Return the sample times, s."""
        return np.asarray(self.t0 + self.dt * np.arange(len(self)), float)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Return `valid`, all true where nothing is missing."""
        return np.ones(len(self), bool) if self.valid is None else self.valid

    def select(self, kind: str, use: str = "estimation") -> Iterator[Part]:
        """Yield the parts of one kind and use, in time order."""
        return (part for part in self.parts if part.kind == kind and part.use == use)

    def using(self, use: str) -> NDArray[np.bool_]:
        """Return where a sample counts for `use` (estimation, selection, report): valid and in such a part.

        A record without parts is all of its own `use`.
        """
        inside = np.zeros(len(self), bool)
        for part in self.parts:
            if part.use == use and part.start is not None:
                inside[part.start : part.stop] = True
        return (inside if self.parts else np.full(len(self), use == self.use)) & self.mask

    def without(self, use: str) -> Record:
        """Return the record with y of the parts of one use hidden (NaN, not valid): nothing can learn from it."""
        hidden = self.using(use)
        return replace(self, y=np.where(hidden, np.nan, self.y), valid=self.mask & ~hidden)
