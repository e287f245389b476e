"""Dead zone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Free, Number
from whid.blocks._knee import Knee, bump, checked, edge_rates, edges, lean, wider
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class DeadZone(Static):
    """Nothing between low and high, a straight line of the given slope outside.

    w = slope·(v − high) for v > high, slope·(v − low) for v < low, 0 between.

          w      ╱
          │     ╱
    ──────┼────●──► v
     ╱ low│   high

    low, high in input units, slope output per input. knee: both corners are rounded by a parabola that wide (input units),
    left out: sharp. Raises `WhidError("block-parameters")` if low > high or knee < 0.

    >>> DeadZone(low=-1.0, high=2.0)([-3.0, 0.0, 5.0], dt=1.0)
    array([-2.,  0.,  3.])
    >>> DeadZone(low=-1.0, high=2.0, knee=1.0)([-3.0, 0.0, 2.0, 5.0], dt=1.0)
    array([-2.   ,  0.   ,  0.125,  3.   ])
    """

    low: Annotated[float, Free("input")]
    high: Annotated[float, Free("input")]
    slope: Number = 1.0
    knee: Knee = None

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise WhidError("block-parameters", f"dead_zone needs low <= high, not {self.low:g} > {self.high:g}")
        checked(self.knee)

    def value(self, v: Floats) -> Floats:
        """Return the distance beyond the zone, times the slope."""
        return np.asarray(self.slope * self._beyond(v))

    def derivative(self, v: Floats) -> Floats:
        """Return the slope outside the zone, 0 inside."""
        rounded = lean(v - self.high, self.knee) - lean(v - self.low, self.knee)
        return np.asarray(self.slope * (((v < self.low) | (v >= self.high)) + rounded))

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the derivative of w with respect to low, high, slope or knee."""
        if name == "slope":
            return self._beyond(v)
        if name == "knee":
            return np.asarray(self.slope * (wider(v - self.high, self.knee) - wider(v - self.low, self.knee)))
        if name == "low":
            return np.asarray(self.slope * (lean(v - self.low, self.knee) - (v < self.low)))
        return np.asarray(-self.slope * ((v >= self.high) + lean(v - self.high, self.knee)))

    def breakpoints(self) -> Floats:
        """Return low and high, or where their knees begin and end."""
        return edges(np.array([self.low, self.high]), self.knee)

    def break_rates(self, name: str) -> Floats:
        """Return how the breakpoints move."""
        rates = np.array([name == "low", name == "high"], float)
        return edge_rates(np.array([self.low, self.high]), rates, self.knee, widening=name == "knee")

    def _beyond(self, v: Floats) -> Floats:
        outside = v - np.clip(v, self.low, self.high)
        return np.asarray(outside + bump(v - self.high, self.knee) - bump(v - self.low, self.knee))
