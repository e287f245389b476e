"""White noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from whid.disturbances._disturbance import Disturbance
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class White(Disturbance):
    """Independent Gaussian noise on every output sample.

    y = x + std·e, e ~ N(0, 1). Source [Brouri2019], section 4 (σ = 0.5).

    >>> White(std=0.5).draw(3, 0.1, np.random.default_rng(0)).round(3)
    array([ 0.126, -0.132,  0.64 ])
    """

    def draw(self, samples: int, dt: float, rng: np.random.Generator) -> Floats:
        """Return independent standard normal numbers."""
        return np.asarray(rng.standard_normal(samples))

    def stream(self, samples: int, dt: float, rng: np.random.Generator) -> Callable[[int], Floats] | None:
        """Return the next of these independent numbers."""
        return lambda n: self.draw(n, dt, rng)

    def covariance(self, lags: int, dt: float) -> Floats:
        """Return 1 at lag 0, nothing elsewhere."""
        return np.asarray(np.eye(1, lags)[0], float)
