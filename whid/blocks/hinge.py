"""A straight line that begins at one level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Free, Number
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Hinge(Static):
    """Nothing below a level, a straight line from there on; beside a curve it gives the curve a kink.

    w = slope·(v − at) for v > at, 0 below

          w       ╱
          │      ╱
    ──────┼─────●────► v
                at

    at in input units, slope output per input.

    >>> Hinge(at=1.0, slope=2.0)([0.0, 1.0, 2.0], dt=1.0)
    array([0., 0., 2.])
    """

    at: Annotated[float, Free("input")]
    slope: Number

    def value(self, v: Floats) -> Floats:
        """Return the line beyond the level."""
        return np.asarray(self.slope * np.maximum(v - self.at, 0.0))

    def derivative(self, v: Floats) -> Floats:
        """Return the slope beyond the level, 0 below."""
        return np.where(v >= self.at, self.slope, 0.0)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the derivative of w with respect to the slope or the level."""
        return np.maximum(v - self.at, 0.0) if name == "slope" else np.where(v >= self.at, -self.slope, 0.0)

    def breakpoints(self) -> Floats:
        """Return the level: the kink."""
        return np.array([self.at])

    def break_rates(self, name: str) -> Floats:
        """Return how the level moves: with itself."""
        return np.array([name == "at"], float)
