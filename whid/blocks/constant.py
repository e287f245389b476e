"""Constant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Constant(Static):
    """A constant, whatever comes in: an offset, as a branch of a `parallel`.

    w = level

          w
    ──────┤─────── level
          │
    ──────┼──────► v

    level in output units.

    >>> Constant(level=-3.16)([1.0, 2.0], dt=1.0)
    array([-3.16, -3.16])
    """

    level: Annotated[float, Free("output")]

    def value(self, v: Floats) -> Floats:
        """Return the level."""
        return np.full(np.shape(v), self.level)

    def derivative(self, v: Floats) -> Floats:
        """Return 0."""
        return np.zeros(np.shape(v))

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return 1."""
        return np.ones(np.shape(v))
