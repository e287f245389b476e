"""Samples taken at slightly wrong times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from whid.disturbances.white import White
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Jitter(White):
    """Independent Gaussian errors of the sampling times, to first order.

    y(t_n) = x(t_n + std·e_n) ≈ x(t_n) + std·ẋ(t_n)·e_n, e ~ N(0, 1); std in s

    >>> Jitter(std=0.01).shape(np.array([0.0, 1.0, 2.0]), 0.5)
    array([2., 2., 2.])
    """

    def stream(self, samples: int, dt: float, rng: np.random.Generator) -> Callable[[int], Floats] | None:
        """Return None: the derivative at a sample needs its neighbours."""
        return None

    def shape(self, undisturbed: Floats, dt: float) -> Floats:
        """Return |dx/dt|, by central differences."""
        return np.abs(np.gradient(undisturbed, dt)) if len(undisturbed) > 1 else np.zeros(len(undisturbed))
