"""Viscous friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whid.blocks._block import Number
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Viscous(Static):
    """Friction in proportion to the velocity, with its own coefficient for motion backwards where one is given.

    w = coefficient·v for v ≥ 0, negative·v for v < 0

          w  ╱
          │ ╱ coefficient
    ──────┼──────► v
       ╱  │
    negative

    Both in output per input (N s/m for a force against a velocity); without `negative` the line is straight.
    Source [Janot2019], the friction model of the positioning system.

    >>> Viscous(coefficient=200.0, negative=180.0)([-1.0, 0.5], dt=1.0)
    array([-180.,  100.])
    """

    coefficient: Number
    negative: Number | None = None

    def value(self, v: Floats) -> Floats:
        """Return the friction force."""
        return np.asarray(self.derivative(v) * v)

    def derivative(self, v: Floats) -> Floats:
        """Return the coefficient of the direction."""
        return np.where(v >= 0, self.coefficient, self.coefficient if self.negative is None else self.negative)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return v where the coefficient acts, 0 elsewhere."""
        return np.where((self.negative is None) | ((v >= 0) == (name == "coefficient")), v, 0.0)

    def breakpoints(self) -> Floats:
        """Return 0 where the coefficients differ: the kink."""
        return np.zeros(0 if self.negative is None else 1)
