"""A square wave about an offset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Lt

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Square(Part):
    """offset + amplitude for the first part of every period, offset − amplitude for the rest.

    u(t) = offset ± amplitude; period in samples, duty the share that is high; lead_periods come first and are not
    averaged. Raises `WhidError("part-parameters")` for a plan without periods. Source [Brouri2014], section 4.

    >>> Square(offset=1, amplitude=2, period=4, periods=1, lead_periods=0).input(0.1, np.random.default_rng(0))
    array([ 3.,  3., -1., -1.])
    """

    offset: float = 0.0
    amplitude: Annotated[float, Gt(0)]
    period: Annotated[int, Ge(2)]
    periods: Annotated[int, Ge(1)] | None = None
    lead_periods: Annotated[int, Ge(0)] = 1
    duty: Annotated[float, Gt(0), Lt(1)] = 0.5

    def __post_init__(self) -> None:
        if self.start is None and self.periods is None:
            raise WhidError("part-parameters", "a planned square needs periods")

    def samples(self, dt: float) -> int:
        """Return lead and measured periods in samples."""
        return self.length if self.periods is None else (self.periods + self.lead_periods) * self.period

    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return the square wave."""
        return self.stretch(dt, rng)(0, self.samples(dt))

    def stretch(self, dt: float, rng: np.random.Generator) -> Callable[[int, int], Floats]:
        """Return any stretch of the square wave."""

        def square(first: int, last: int) -> Floats:
            phase = np.arange(first, last) % self.period
            return self.offset + self.amplitude * np.where(phase < round(self.duty * self.period), 1.0, -1.0)

        return square

    def numbers(self, dt: float) -> int:
        """Return that none is kept."""
        return 0
