"""A jump at one level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Jump(Static):
    """Nothing below a level, a constant from there on; beside a curve it makes the curve jump.

    w = height for v ≥ at, 0 below

          w    ┌──── height
          │    │
    ──────┼────●─────► v
               at

    at in input units, height in output units.

    >>> Jump(at=1.0, height=0.5)([0.0, 1.0, 2.0], dt=1.0)
    array([0. , 0.5, 0.5])
    """

    at: Annotated[float, Free("input")]
    height: Annotated[float, Free("output")]

    def value(self, v: Floats) -> Floats:
        """Return the height beyond the level."""
        return np.where(v >= self.at, self.height, 0.0)

    def derivative(self, v: Floats) -> Floats:
        """Return 0."""
        return np.zeros(np.shape(v))

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return 1 beyond the level for the height, nothing for the level itself."""
        return np.where(v >= self.at, 1.0, 0.0) if name == "height" else np.zeros(np.shape(v))

    def breakpoints(self) -> Floats:
        """Return the level."""
        return np.array([self.at])

    def break_rates(self, name: str) -> Floats:
        """Return how the level moves: with itself."""
        return np.array([name == "at"], float)

    def jumps(self) -> Floats:
        """Return the height."""
        return np.array([self.height])
