"""Preload."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Free, Number
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Preload(Static):
    """A straight line with a jump at zero: a spring with preload.

    w = slope·v + offset·sign(v), sign(0) = 0

          w   ╱
          │  ╱
    offset│ ╱
    ──────●──────► v
        ╱ │
       ╱

    offset in output units (half the jump), slope output per input.

    >>> Preload(offset=0.5)([-2.0, 0.0, 1.0], dt=1.0)
    array([-2.5,  0. ,  1.5])
    """

    offset: Annotated[float, Free("output")]
    slope: Number = 1.0

    def value(self, v: Floats) -> Floats:
        """Return the line and the preload."""
        return np.asarray(self.slope * v + self.offset * np.sign(v))

    def derivative(self, v: Floats) -> Floats:
        """Return the slope."""
        return np.full(np.shape(v), self.slope)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the derivative of w with respect to slope or offset."""
        return np.array(v if name == "slope" else np.sign(v), float)

    def breakpoints(self) -> Floats:
        """Return 0: the jump."""
        return np.zeros(1)

    def jumps(self) -> Floats:
        """Return twice the offset."""
        return np.array([2 * self.offset])
