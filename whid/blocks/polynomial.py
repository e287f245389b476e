"""Polynomial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import MinLen

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Polynomial(Static):
    """A polynomial in its input, coefficients ascending.

    w = c₀ + c₁v + c₂v² + … + cₙvⁿ

          w    │   ╱
          │    ╰──╯
    ──────┼─────────► v
        ╱ │

    coefficients[k] in output/inputᵏ, as in `numpy.polynomial`. No breakpoints.

    >>> Polynomial(coefficients=(-25.0, 0.0, 31.25))([0.0, 1.0, 2.0], dt=1.0)
    array([-25.  ,   6.25, 100.  ])
    """

    coefficients: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(1)]

    def value(self, v: Floats) -> Floats:
        """Return the polynomial."""
        return np.asarray(np.polynomial.polynomial.polyval(v, self.coefficients))

    def derivative(self, v: Floats) -> Floats:
        """Return its derivative."""
        return np.asarray(np.polynomial.polynomial.polyval(v, np.polynomial.polynomial.polyder(self.coefficients)))

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return vᵏ for coefficient k."""
        return np.asarray(v ** int(name.partition(".")[2]))

    def sensitivities(self, v: Floats, names: Sequence[str], out: Floats) -> None:
        """Write the powers, each from the one before."""
        powers = [np.ones_like(v)]
        for row, name in zip(out, names, strict=True):
            while len(powers) <= int(name.partition(".")[2]):
                powers.append(powers[-1] * v)
            row[...] = powers[int(name.partition(".")[2])]
