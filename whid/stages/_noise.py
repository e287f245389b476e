"""Stationary noise on stretches of constant input: its autocovariance, hence the variance of any mean.

One autoregression for all stretches (pooled), its order by BIC, the bias of removing means or trends taken out exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from whid.signal import Floats

_LAGS = 4096  # the autocovariance is carried this far, or to the longest stretch
_EQUAL = 1e-4  # below this p of Bartlett's test every stretch keeps a noise level of its own


class Noise(NamedTuple):
    """Pooled noise of H stretches: e = Σ a·e(past) + innovation, times √scale on each stretch."""

    ar: Floats  # (p,)
    autocovariance: Floats  # (lags,) from lag 0
    long_run_variance: float  # Σ of the autocovariance over all lags = lim n·var(mean of n)
    scale: Floats  # (H,) variance of a stretch relative to the pooled one; ones where all are alike

    def variance_of_mean(self, samples: NDArray[np.intp]) -> Floats:
        """Return var of the mean of n consecutive samples, (γ₀ + 2 Σ (1 − k/n) γₖ)/n, for an array of n."""
        lag = np.arange(len(self.autocovariance))
        doubled = np.where(lag == 0, 1.0, 2.0) * self.autocovariance
        flat, ramp = np.cumsum(doubled), np.cumsum(doubled * lag)
        last = np.minimum(samples, len(lag)) - 1
        return np.asarray((flat[last] - ramp[last] / samples) / samples)

    def variance_of_masked_mean(self, valid: NDArray[np.bool_]) -> float:
        """Return var of the mean of the valid samples of one stretch, Σ γₖ·(pairs k apart)/n²."""
        pairs = _correlation(valid[:, None].astype(float), valid[:, None].astype(float), len(self.autocovariance))[:, 0, 0]
        return float((2 * self.autocovariance @ pairs - self.autocovariance[0] * pairs[0]) / pairs[0] ** 2)


def estimate_noise(holds: Sequence[Floats], degree: int = 0, max_order: int = 20) -> Noise:
    """Fit one autoregression to what a polynomial trend of the given degree leaves of each stretch; NaN is missing.

    The autocovariances are Yule-Walker's, corrected to what they would be had no trend been removed: the expected loss
    under the model is computed exactly and added back until it settles.
    """
    shapes = _trends(holds, degree)
    residuals = [np.where(np.isfinite(y), y, 0.0) for y in holds]
    residuals = [y - q @ (q.T @ y) for y, q in zip(residuals, shapes, strict=True)]
    longest = max(map(len, holds))
    order = int(min(max_order, np.median([len(y) for y in holds]) // 8))
    gap = np.zeros(order + 1)  # between stretches, so that lagged products never mix two of them
    flat = np.concatenate([np.append(r, gap) for r in residuals])
    valid = np.concatenate([np.append(np.isfinite(y), gap) for y in holds])
    products, pairs = _lagged(flat, order + 1), np.maximum(_lagged(valid, order + 1), 1.0)
    lost = np.zeros(order + 1)
    previous = np.inf
    for _ in range(20):
        ar, innovation = _autoregression((products + lost) / pairs, pairs[0])
        covariance = _extended(ar, innovation, min(longest, _LAGS))
        variance = innovation / (1 - ar.sum()) ** 2
        if abs(variance - previous) <= 1e-3 * variance:
            break
        previous = variance
        lost = _lost(shapes, covariance, order + 1)
    return Noise(ar, covariance, float(variance), _scale(flat, valid, ar, np.cumsum([len(y) + order + 1 for y in holds])))


def quantum_of(values: Floats) -> float:
    """Return the step of a coarsely quantised signal, 0 when there is none: few distinct values, all on one grid.

    >>> quantum_of(np.repeat([0.0, 0.25, 0.75, 1.0], 10)), quantum_of(np.random.default_rng(0).normal(size=40))
    (0.25, 0.0)
    """
    seen = values[np.isfinite(values)][:100_000]
    distinct = np.unique(seen)
    if len(distinct) < 2 or len(distinct) > len(seen) / 4:
        return 0.0
    spacing = np.diff(distinct)
    fine = spacing[spacing > 1e-9 * np.ptp(distinct)]
    step = float(fine.min())
    off_grid = np.abs(fine / step - np.round(fine / step))
    return step if np.median(off_grid) < 0.02 else 0.0


def quantisation_variance(std: Floats, quantum: float) -> Floats:
    """Return the variance that rounding leaves in a mean, however long, when the noise is too small to dither it.

    Σₖ ½ (Δ/πk)² exp(−4π²k²σ²/Δ²): Δ²/12 without noise, nothing from σ = Δ/2 on. std is that of the rounded signal.
    """
    if quantum == 0:
        return np.zeros_like(std)
    dither = np.maximum(std**2 / quantum**2 - 1 / 12, 0.0)
    k = np.arange(1, 200)
    terms = np.exp(-4 * np.pi**2 * k**2 * dither[:, None]) / (2 * (np.pi * k) ** 2)
    return np.asarray(quantum**2 * terms.sum(axis=1))


def _trends(holds: Sequence[Floats], degree: int) -> list[Floats]:
    """Return an orthonormal basis (n, q) of the polynomials on each hold; complete holds of one length share theirs."""
    here = [np.isfinite(hold) for hold in holds]
    return [_whole_trend(len(valid), degree) if valid.all() else _trend(valid, degree) for valid in here]


@lru_cache(maxsize=4)
def _whole_trend(samples: int, degree: int) -> Floats:
    return _trend(np.ones(samples, bool), degree)


def _trend(valid: NDArray[np.bool_], degree: int) -> Floats:
    design = legendre.legvander(np.linspace(-1, 1, len(valid)), degree) * valid[:, None]
    return np.linalg.qr(design[:, : max(1, min(degree + 1, int(valid.sum()) - 1))])[0]


def _lagged(x: Floats, lags: int) -> Floats:
    return np.array([x[: len(x) - k] @ x[k:] for k in range(lags)])


def _correlation(a: Floats, b: Floats, lags: int) -> Floats:
    """Return Σ_t a[t, i] b[t + k, j] as (lags, i, j)."""
    size = _fast(2 * len(a))
    spectrum = np.fft.rfft(a, size, axis=0).conj()[:, :, None] * np.fft.rfft(b, size, axis=0)[:, None, :]
    full = np.fft.irfft(spectrum, size, axis=0)[: min(lags, len(a))]
    return np.asarray(np.pad(full, ((0, lags - len(full)), (0, 0), (0, 0))))


def _lost(shapes: Sequence[Floats], covariance: Floats, lags: int) -> Floats:
    """Return what removing the trends takes from Σ e(t) e(t + k), expected: tr(SΓ) − tr(MSMΓ), M = I − QQᵀ."""
    total = np.zeros(lags)
    known: dict[int, Floats] = {}
    for q in shapes:
        if id(q) not in known and not covariance[1:].any():  # Γ = γ₀: both traces are those of Q's own products
            known[id(q)] = covariance[0] * np.sum([_lagged(column, lags) for column in q.T], axis=0)
        elif id(q) not in known:
            smoothed = _toeplitz(covariance, q) * np.any(q != 0, axis=1)[:, None]
            both = _correlation(q, smoothed, lags) + _correlation(smoothed, q, lags)
            inner = np.einsum("kij,ji->k", _correlation(q, q, lags), q.T @ smoothed)
            known[id(q)] = np.einsum("kii->k", both) - inner
        total += known[id(q)]
    return total


def _toeplitz(covariance: Floats, q: Floats) -> Floats:
    """Return Γq for the Toeplitz matrix Γ of the autocovariance."""
    n, size = len(q), _fast(2 * len(q))
    column = np.zeros(size)
    kept = min(len(covariance), n)
    column[:kept] = covariance[:kept]
    column[size - kept + 1 :] = covariance[kept - 1 : 0 : -1]
    spectrum = np.fft.rfft(column)[:, None] * np.fft.rfft(q, size, axis=0)
    return np.asarray(np.fft.irfft(spectrum, size, axis=0)[:n])


def _fast(size: int) -> int:
    """Return the next power of two: a length with a large prime factor costs ten times as much."""
    return 1 << (size - 1).bit_length()


def _autoregression(autocovariance: Floats, samples: float) -> tuple[Floats, float]:
    """Return coefficients and innovation variance by Levinson's recursion, the order by BIC."""
    ar, variance = np.empty(0), float(autocovariance[0])
    best, least = (ar, variance), samples * np.log(max(variance, 1e-300))
    for order in range(1, len(autocovariance)):
        if variance <= 1e-14 * autocovariance[0]:
            break
        reflection = (autocovariance[order] - ar @ autocovariance[order - 1 : 0 : -1]) / variance
        if abs(reflection) >= 0.9999:
            break
        ar = np.append(ar - reflection * ar[::-1], reflection)
        variance *= 1 - reflection**2
        criterion = samples * np.log(variance) + order * np.log(samples)
        if criterion < least:
            best, least = (ar, variance), criterion
    return best


def _extended(ar: Floats, innovation: float, lags: int) -> Floats:
    """Return the autocovariance of an autoregression to any lag: ψ ⋆ ψ of its impulse response."""
    from scipy.signal import lfilter

    if not len(ar):
        return np.append(innovation, np.zeros(lags - 1))
    pulse = np.zeros(_fast(max(2 * lags, 64)))
    pulse[0] = 1.0
    response = lfilter([1.0], np.append(1.0, -ar), pulse)
    spectrum = np.abs(np.fft.rfft(response, 2 * len(pulse))) ** 2
    return np.asarray(innovation * np.fft.irfft(spectrum)[:lags])


def _scale(flat: Floats, valid: Floats, ar: Floats, ends: NDArray[np.intp]) -> Floats:
    """Return each stretch's innovation variance over the pooled one, or ones where Bartlett's test finds them alike."""
    from scipy.special import chdtrc

    innovation, known = flat.copy(), valid > 0
    for lag, a in enumerate(ar, 1):
        innovation[lag:] -= a * flat[:-lag]
        known[lag:] &= valid[:-lag] > 0
        known[:lag] = False
    starts = np.append(0, ends[:-1])
    dof = np.maximum(np.add.reduceat(known.astype(float), starts) - 1, 1.0)
    squares = np.add.reduceat(np.where(known, innovation, 0.0) ** 2, starts)
    pooled = squares.sum() / dof.sum()
    if pooled == 0 or len(dof) < 2:
        return np.ones(len(dof))
    ratio = squares / dof / pooled
    bartlett = -float(dof @ np.log(np.maximum(ratio, 1e-30)))
    correction = 1 + (np.sum(1 / dof) - 1 / dof.sum()) / (3 * (len(dof) - 1))
    return ratio if chdtrc(len(dof) - 1, bartlett / correction) < _EQUAL else np.ones(len(dof))
