"""Process noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Gt

from whid.disturbances._disturbance import Disturbance, Place
from whid.disturbances.ar import Ar
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Process(Disturbance):
    """Gaussian noise ahead of the first nonlinear block, held between samples: it goes through the nonlinearity.

    v = front(u) + std·e; e white, or with a bandwidth (rad/s) first-order: e_t = e^(−bandwidth·dt)·e_{t−1} + white.

    >>> Process(std=0.1, bandwidth=5.0).covariance(3, 0.1).round(3)
    array([1.   , 0.607, 0.368])
    """

    place: ClassVar[Place] = "nonlinearity"
    bandwidth: Annotated[float, Gt(0)] | None = None

    def draw(self, samples: int, dt: float, rng: np.random.Generator) -> Floats:
        """Return stationary noise of unit variance."""
        return self._coloured(dt).draw(samples, dt, rng)

    def stream(self, samples: int, dt: float, rng: np.random.Generator) -> Callable[[int], Floats] | None:
        """Return the next of this noise."""
        return self._coloured(dt).stream(samples, dt, rng)

    def covariance(self, lags: int, dt: float) -> Floats:
        """Return e^(−bandwidth·dt·k) at lag k; without a bandwidth 1 at lag 0 only."""
        return self._coloured(dt).covariance(lags, dt)

    def _coloured(self, dt: float) -> Ar:
        memory = 0.0 if self.bandwidth is None else float(np.exp(-self.bandwidth * dt))
        return Ar(coefficients=(memory,), std=1.0)
