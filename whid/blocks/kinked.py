"""A polynomial with kinks: continuous pieces whose breaks a fit can move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import MinLen
from numpy.polynomial import polynomial

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Kinked(Static):
    """A polynomial that changes at each break, continuously: pieces that always meet, wherever a fit moves the breaks.

    w = Σ cₘ·vᵐ + Σₖ Σₘ kinks[k][m − 1]·max(v − breaks[k], 0)ᵐ,  m from 1 in the second sum

          w     ╭──
          │   ╱
    ──────┼──╱─────► v
       ──╯  b₀

    coefficients ascending, in output/inputᵐ; breaks ascending, input units; kinks one list a break: the change of slope
    there, of curvature/2, … . Raises `WhidError("block-parameters")` for breaks that do not ascend or a wrong number of
    lists.

    >>> Kinked(coefficients=(0.0, 1.0), breaks=(1.0,), kinks=((-1.0, 0.5),))([-1.0, 1.0, 3.0], dt=1.0)
    array([-1.,  1.,  3.])
    """

    coefficients: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(1)]
    breaks: Annotated[tuple[Annotated[float, Free("input")], ...], MinLen(1)]
    kinks: Annotated[tuple[Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(1)], ...], MinLen(1)]

    def __post_init__(self) -> None:
        if len(self.kinks) != len(self.breaks):
            raise WhidError("block-parameters", f"{len(self.breaks)} breaks need as many kinks, not {len(self.kinks)}")
        if any(b >= a for b, a in zip(self.breaks, self.breaks[1:], strict=False)):
            raise WhidError("block-parameters", f"breaks must ascend: {list(self.breaks)}")

    def value(self, v: Floats) -> Floats:
        """Return the polynomial and what the kinks add."""
        out = np.asarray(polynomial.polyval(v, self.coefficients), float)
        return out + sum(_from(v - b, (0.0, *row)) for b, row in zip(self.breaks, self.kinks, strict=True))

    def derivative(self, v: Floats) -> Floats:
        """Return the slope; at a break that to its right."""
        out = np.asarray(polynomial.polyval(v, polynomial.polyder(self.coefficients)), float)
        return out + sum(self._slope(v, k) for k in range(len(self.breaks)))

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return vᵐ, the truncated power, or minus the slope that a break begins."""
        head, *place = name.split(".")
        if head == "coefficients":
            return np.asarray(v ** int(place[0]) * np.ones_like(v))
        if head == "breaks":
            return -self._slope(v, int(place[0]))
        return truncated(v - self.breaks[int(place[0])], int(place[1]) + 1)

    def breakpoints(self) -> Floats:
        """Return the breaks."""
        return np.array(self.breaks, float)

    def break_rates(self, name: str) -> Floats:
        """Return 1 for the break itself."""
        return np.array([name == f"breaks.{k}" for k in range(len(self.breaks))], float)

    def _slope(self, v: Floats, k: int) -> Floats:
        return _from(v - self.breaks[k], np.asarray(polynomial.polyder((0.0, *self.kinks[k])), float))


def truncated(x: Floats, power: int) -> Floats:
    """Return max(x, 0)ᵐ, m ≥ 1."""
    return np.asarray(np.maximum(x, 0.0) ** power)


def _from(x: Floats, coefficients: Floats | tuple[float, ...]) -> Floats:
    """Return a polynomial of x from 0 on, nothing before."""
    return np.where(x >= 0, polynomial.polyval(x, coefficients), 0.0)
