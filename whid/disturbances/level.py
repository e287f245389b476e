"""Noise in proportion to the output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whid.disturbances.white import White
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Level(White):
    """Independent Gaussian noise whose size follows the undisturbed output, beside other noises.

    y = x + std·x·e, e ~ N(0, 1); std is relative, 0.01 is one per cent of the reading.

    >>> Level(std=0.1).shape(np.array([1.0, -2.0]), 0.1)
    array([1., 2.])
    """

    def shape(self, undisturbed: Floats, dt: float) -> Floats:
        """Return |x|."""
        return np.abs(undisturbed)
