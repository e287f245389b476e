"""Coloured noise: autoregressive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import MinLen

from whid.disturbances._disturbance import Disturbance
from whid.errors import WhidError
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Ar(Disturbance):
    """Autoregressive Gaussian noise of any order on every output sample, stationary from the first.

    e_t = a₁e_{t−1} + … + a_p e_{t−p} + white, scaled to the given size; coefficients (a₁, …, a_p) a sample.

    Raises `WhidError("disturbance-unstable")` if a root of z^p − a₁z^{p−1} − … − a_p is not inside the unit circle.
    Source [Brockwell and Davis 1991, Time Series: Theory and Methods], section 3.1.

    >>> Ar(coefficients=(0.9,), std=0.5).covariance(3, 0.1).round(3)
    array([1.  , 0.9 , 0.81])
    """

    coefficients: Annotated[tuple[float, ...], MinLen(1)]

    def __post_init__(self) -> None:
        super().__post_init__()
        largest = np.abs(np.roots([1.0, *(-a for a in self.coefficients)])).max(initial=0.0)
        if largest >= 1:
            raise WhidError("disturbance-unstable", f"ar has a root of size {largest:.6g}; all must be below 1")

    def draw(self, samples: int, dt: float, rng: np.random.Generator) -> Floats:
        """Return stationary noise: the first p samples from their joint distribution, the rest by the recursion."""
        return self.stream(samples, dt, rng)(samples)

    def stream(self, samples: int, dt: float, rng: np.random.Generator) -> Callable[[int], Floats]:
        """Return the next of this noise."""
        from scipy.linalg import toeplitz
        from scipy.signal import lfilter, lfiltic

        a = np.array(self.coefficients)
        r = self.covariance(len(a) + 1, dt)
        start = np.linalg.cholesky(toeplitz(r[:-1])) @ rng.standard_normal(len(a))
        state = lfiltic([1.0], [1.0, *-a], start[::-1])

        def following(n: int) -> Floats:
            nonlocal start, state
            first, start = start[:n], start[n:]
            white = np.sqrt(1 - a @ r[1:]) * rng.standard_normal(n - len(first))
            rest, state = lfilter([1.0], [1.0, *-a], white, zi=state)
            return np.concatenate([first, rest])

        return following

    def covariance(self, lags: int, dt: float) -> Floats:
        """Return the autocorrelation: the Yule-Walker equations to lag p, then the recursion."""
        a = np.array(self.coefficients)
        p = len(a)
        equations, right = np.eye(p), np.zeros(p)  # r_k − Σ a_j r_|k−j| = 0 for k = 1 … p, with r_0 = 1
        for k in range(1, p + 1):
            for j in range(1, p + 1):
                if k == j:
                    right[k - 1] += a[j - 1]
                else:
                    equations[k - 1, abs(k - j) - 1] -= a[j - 1]
        r = np.concatenate([[1.0], np.linalg.solve(equations, right), np.zeros(max(lags - p - 1, 0))])
        for k in range(p + 1, lags):
            r[k] = a @ r[k - p : k][::-1]
        return r[:lags]
