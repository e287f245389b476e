"""What every experiment part is: one vocabulary for what is planned, simulated, measured or proposed."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from annotated_types import Ge

from whid.kinds import Kind
from whid.signal import Floats

Use = Literal["estimation", "selection", "report"]


@dataclass(frozen=True, kw_only=True)
class Part(Kind):
    """One stretch of the input. Planned: `start` is None. In a record: samples start … stop − 1 (half-open).

    use: estimation fits, selection ranks, report is opened once, after every choice is frozen.
    """

    family: ClassVar[str] = "whid.experiments"
    start: Annotated[int, Ge(0)] | None = None
    stop: Annotated[int, Ge(1)] | None = None
    use: Use = "estimation"

    def expand(self, dt: float) -> tuple[Part, ...]:
        """Return the single experiments this plan stands for, each with its length fixed for this dt."""
        return (self,)

    @abstractmethod
    def samples(self, dt: float) -> int:
        """Return how many samples one expanded part takes."""

    @abstractmethod
    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return u of one expanded part, (samples,)."""

    def stretch(self, dt: float, rng: np.random.Generator) -> Callable[[int, int], Floats]:
        """Return a function that gives samples first … last − 1 of u: everything random is drawn now, and only once.

        A leaf that need not make all samples for some of them overrides it, and says in `numbers` what it must keep.
        """
        u = self.input(dt, rng)
        return lambda first, last: u[first:last]

    def numbers(self, dt: float) -> int:
        """Return how many numbers a stretch of it needs in memory."""
        return 8 * self.samples(dt)

    def placed(self, start: int, dt: float) -> Self:
        """Return the expanded part at its place in a record."""
        return replace(self, start=start, stop=start + self.samples(dt))

    @property
    def length(self) -> int:
        """Return the samples of a placed part."""
        return (self.stop or 0) - (self.start or 0)
