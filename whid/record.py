"""Record: what was measured. Identification sees Records and nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from whid.experiments._part import Part, Use
from whid.signal import Floats

Intersample = Literal["zoh", "foh", "bandlimited", "discrete"]
Initial = Literal["rest", "steady", "free"]
CHUNK = 1 << 15  # samples: what a chain makes of a chunk stays in the cache


class Chunk(NamedTuple):
    """Some samples of a record, from number `start` on; y is NaN where it is missing or not to be seen."""

    start: int
    u: Floats
    y: Floats


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

    def chunks(self, outputs: bool = True) -> Iterator[Chunk]:
        """Yield the samples in order, as a record too long for memory does."""
        for start in range(0, len(self), CHUNK):
            part = slice(start, start + CHUNK)
            y = self.y[part] if self.valid is None else np.where(self.valid[part], self.y[part], np.nan)
            yield Chunk(start, self.u[part], y)

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

    def has(self, use: str) -> bool:
        """Tell whether any sample is for a use."""
        return bool(self.using(use).any())

    def without(self, use: str) -> Record:
        """Return the record with y of the parts of one use hidden (NaN, not valid): nothing can learn from it."""
        hidden = self.using(use)
        return replace(self, y=np.where(hidden, np.nan, self.y), valid=self.mask & ~hidden)


class Planned(Protocol):
    """What says which sample is for which use."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """Return what happens when."""

    @property
    def use(self) -> Use:
        """Return what it is for without parts."""


def time_constants(records: Sequence[Record]) -> tuple[float, float]:
    """Return the shortest and the longest time constant that records can show, s: a sample, the longest record."""
    return min(record.dt for record in records), max(len(record) * record.dt for record in records)


def used(record: Planned, chunk: Chunk, use: str) -> NDArray[np.bool_]:
    """Return where the samples of a chunk count for a use, as `Record.using` does of all.

    >>> record = Record(u=np.zeros(3), y=np.array([1.0, np.nan, 2.0]), dt=1.0)
    >>> [used(record, chunk, "estimation").tolist() for chunk in record.chunks()]
    [[True, False, True]]
    """
    inside = np.full(len(chunk.u), not record.parts and record.use == use)
    for part in record.parts:
        if part.use == use and part.start is not None and part.stop is not None:
            inside[max(0, part.start - chunk.start) : max(0, part.stop - chunk.start)] = True
    return inside & np.isfinite(chunk.y)
