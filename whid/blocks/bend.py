"""A straight line that is slightly bent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, MinLen
from numpy.polynomial import polynomial

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Bend(Static):
    """The same signal, bent: what an actuator or a sensor that should be linear does to it.

    w = v + offset + Σ_k coefficients[k]·((v − centre)/scale)^(k+2)

          w    ╭──
          │  ╱
    ──────┼╱─────► v
       ╭──╯

    coefficients in the signal's units: how far the line is off at v = centre + scale, by the square, the cube, …; centre and
    scale in input units stay as they are in a fit. Slope 1 at v = centre: a gain is other blocks' business. So is the offset
    where they have one; hold it then.

    >>> Bend(coefficients=(0.0, -0.1), scale=2.0)([-2.0, 0.0, 1.0, 2.0], dt=1.0)
    array([-1.9   ,  0.    ,  0.9875,  1.9   ])
    """

    coefficients: Annotated[tuple[Annotated[float, Free("input")], ...], MinLen(1)]
    centre: float = 0.0
    scale: Annotated[float, Gt(0)] = 1.0
    offset: Annotated[float, Free("input")] = 0.0

    def value(self, v: Floats) -> Floats:
        """Return the bent line."""
        return np.asarray(v + polynomial.polyval(self._x(v), (self.offset, 0.0, *self.coefficients)))

    def derivative(self, v: Floats) -> Floats:
        """Return 1 and the slope of the bend."""
        rate = polynomial.polyder((0.0, 0.0, *self.coefficients))
        return np.asarray(1 + polynomial.polyval(self._x(v), rate) / self.scale)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the power of the coefficient, 1 for the offset."""
        if name == "offset":
            return np.ones_like(v)
        return np.asarray(self._x(v) ** (2 + int(name.partition(".")[2])))

    def _x(self, v: Floats) -> Floats:
        return np.asarray((v - self.centre) / self.scale)
