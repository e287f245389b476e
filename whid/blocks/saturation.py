"""Saturation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Free, Number
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Saturation(Static):
    """A straight line between low and high, constant beyond: a clip.

    w = slope·min(max(v, low), high)

          w    ╭────
          │   ╱
    ──────┼──╱──┬──► v
         low╱  high
    ───────╯

    low, high in input units, slope output per input. Raises `WhidError("block-parameters")` if low > high.

    >>> Saturation(low=-1.0, high=2.0)([-3.0, 0.5, 5.0], dt=1.0)
    array([-1. ,  0.5,  2. ])
    """

    low: Annotated[float, Free("input")]
    high: Annotated[float, Free("input")]
    slope: Number = 1.0

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise WhidError("block-parameters", f"saturation needs low <= high, not {self.low:g} > {self.high:g}")

    def value(self, v: Floats) -> Floats:
        """Return the clipped line."""
        return np.asarray(self.slope * np.clip(v, self.low, self.high))

    def derivative(self, v: Floats) -> Floats:
        """Return the slope inside, 0 beyond."""
        return np.where((v >= self.low) & (v < self.high), self.slope, 0.0)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the derivative of w with respect to low, high or slope."""
        if name == "slope":
            return np.asarray(np.clip(v, self.low, self.high))
        return np.where(v < self.low if name == "low" else v >= self.high, self.slope, 0.0)

    def breakpoints(self) -> Floats:
        """Return low and high: the kinks."""
        return np.array([self.low, self.high])

    def break_rates(self, name: str) -> Floats:
        """Return how low and high move: each with itself."""
        return np.array([name == "low", name == "high"], float)
