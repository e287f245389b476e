"""Single wild samples."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le

from whid.disturbances._disturbance import Disturbance
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Outliers(Disturbance):
    """Few samples with a large independent error, none on the others.

    e = b·N(0, 1)/√rate, b = 1 with probability rate, else 0; std is that of all samples together

    >>> int(np.count_nonzero(Outliers(std=1.0, rate=0.01).draw(1000, 0.1, np.random.default_rng(0))))
    11
    """

    rate: Annotated[float, Gt(0), Le(1)] = 0.01

    def draw(self, samples: int, dt: float, rng: np.random.Generator) -> Floats:
        """Return the wild errors, of unit variance over all samples."""
        hit = rng.random(samples) < self.rate
        return np.where(hit, rng.standard_normal(samples) / np.sqrt(self.rate), 0.0)

    def stream(self, samples: int, dt: float, rng: np.random.Generator) -> Callable[[int], Floats] | None:
        """Return the next: which are hit from the generator as it is, their errors from where it stands after that."""
        errors = copy.deepcopy(rng)
        if not hasattr(errors.bit_generator, "advance"):
            return None
        errors.bit_generator.advance(samples)

        def following(n: int) -> Floats:
            hit = rng.random(n) < self.rate
            return np.where(hit, errors.standard_normal(n) / np.sqrt(self.rate), 0.0)

        return following

    def covariance(self, lags: int, dt: float) -> Floats:
        """Return 1 at lag 0, nothing elsewhere."""
        return np.asarray(np.eye(1, lags)[0], float)
