"""What a converter rounds away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whid.disturbances.white import White
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Rounding(White):
    """The error of a converter whose step is small against everything else: uniform and independent.

    e uniform on ±√3·std; a step of std·√12

    >>> float(np.abs(Rounding(std=1.0).draw(1000, 0.1, np.random.default_rng(0))).max().round(2))
    1.73
    """

    def draw(self, samples: int, dt: float, rng: np.random.Generator) -> Floats:
        """Return independent uniform numbers of unit variance."""
        return np.asarray(rng.uniform(-np.sqrt(3), np.sqrt(3), samples))
