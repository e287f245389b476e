"""LongRecord: what was measured where it does not fit into memory. The same facts as a Record, the samples in chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from whid.experiments._part import Part, Use
from whid.record import Chunk, Initial, Intersample, Record, used

Read = Callable[[bool], Iterator[Chunk]]


@dataclass(frozen=True, eq=False)
class LongRecord:
    """A record that is read, or simulated anew, chunk by chunk, as often as somebody asks.

    samples  N
    read     read(outputs) → the chunks in order, from the first sample on; without outputs y may be anything but NaN where
             it is not missing
    hidden   uses whose outputs nobody may see: NaN
    The other fields are those of a `Record`.
    """

    samples: int
    read: Read
    dt: float
    t0: float = 0.0
    units: dict[str, str] = field(default_factory=lambda: {"input": "1", "output": "1"})
    intersample: Intersample = "zoh"
    initial: Initial = "rest"
    parts: tuple[Part, ...] = ()
    name: str = "record"
    use: Use = "estimation"
    hidden: tuple[str, ...] = ()

    def __len__(self) -> int:
        return self.samples

    def chunks(self, outputs: bool = True) -> Iterator[Chunk]:
        """Yield the samples in order; y is NaN where it is missing or hidden."""
        for chunk in self.read(outputs):
            y = chunk.y
            for use in self.hidden:
                y = np.where(used(self, chunk, use), np.nan, y)
            yield chunk._replace(y=y)

    def select(self, kind: str, use: str = "estimation") -> Iterator[Part]:
        """Yield the parts of one kind and use, in time order."""
        return (part for part in self.parts if part.kind == kind and part.use == use)

    def has(self, use: str) -> bool:
        """Tell whether any of it is for a use."""
        return any(part.use == use for part in self.parts) if self.parts else self.use == use

    def without(self, use: str) -> LongRecord:
        """Return the record with y of the parts of one use hidden: nothing can learn from it."""
        return replace(self, hidden=(*self.hidden, use))

    def head(self, samples: int) -> Record:
        """Return its beginning as a record without parts, of one use."""
        us, ys, count = [], [], 0
        for chunk in self.chunks():
            us.append(chunk.u)
            ys.append(chunk.y)
            count += len(chunk.u)
            if count >= samples:
                break
        u, y = np.concatenate(us)[:samples], np.concatenate(ys)[:samples]
        valid: NDArray[np.bool_] = np.isfinite(y)
        return Record(
            u, y, self.dt, self.t0, None if valid.all() else valid, self.units, self.intersample, self.initial,
            name=self.name, use=self.use,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Thinned(Record):
    """What a result keeps of a long record: every so many-th sample, for pictures and a first look; not to be fitted."""

    every: int = 1
    samples: int = 0  # of the long record
    was: tuple[Part, ...] = ()  # its parts
