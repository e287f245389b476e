"""A constant input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt

from whid.experiments._part import Part
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Hold(Part):
    """A constant level, held; direction says whether the level was reached from below (up) or above (down).

    u(t) = level for hold_s seconds. Source [Brouri2019], eq. (3.3).

    >>> Hold(level=2.0, hold_s=0.3).input(0.1, np.random.default_rng(0))
    array([2., 2., 2.])
    """

    level: float
    hold_s: Annotated[float, Gt(0)] | None = None
    direction: Literal["up", "down"] | None = None

    def samples(self, dt: float) -> int:
        """Return hold_s in samples, or the length of the stretch found in a record."""
        return self.length if self.hold_s is None else max(1, round(self.hold_s / dt))

    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return the constant."""
        return self.stretch(dt, rng)(0, self.samples(dt))

    def stretch(self, dt: float, rng: np.random.Generator) -> Callable[[int, int], Floats]:
        """Return any stretch of the constant."""
        return lambda first, last: np.full(last - first, self.level)

    def numbers(self, dt: float) -> int:
        """Return that none is kept."""
        return 0
