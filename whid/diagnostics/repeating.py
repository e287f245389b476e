"""Does the residual repeat with the excitation: harmonics against the lines between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whid.signal import Floats

AROUND = 12  # lines between the harmonics, on either side, that tell the noise at a harmonic


class Repeating(NamedTuple):
    """The part of a residual that repeats from period to period.

    statistic  mean over the harmonics of power against the noise around: 1 when nothing repeats
    lines      harmonic numbers, with the ratio of each
    share      of the power above the noise that lies on odd harmonics
    """

    statistic: float
    p: float
    lines: Floats
    ratio: Floats
    share_odd: float


def repeating(residual: Floats) -> Repeating:
    """Test the harmonics of a periodic residual against the noise at their neighbours [Schoukens and Pintelon 2012].

    residual (P, n), P ≥ 2 periods. Its spectrum over all P·n samples has the periodic part on every P-th line and noise
    everywhere; F = |E|²/mean of the neighbours' |E|² has, without a periodic part, an F distribution with 2 and 4·AROUND
    degrees of freedom, whatever the colour of a noise that is smooth in frequency. Σ F over the harmonics is compared with
    a gamma distribution of the same mean and variance; the largest F on its own, over all lines. p is twice the smaller.

    >>> rng = np.random.default_rng(0)
    >>> e = rng.standard_normal((4, 256))
    >>> wave = 0.5 * np.sin(2 * np.pi * 3 * np.arange(256) / 256)
    >>> repeating(e).p > 0.01, repeating(e + wave).p < 1e-9
    (True, True)
    """
    from scipy.stats import f, gamma

    periods, n = residual.shape
    power = np.abs(np.fft.rfft(residual.ravel() - residual.mean())) ** 2
    last = (n - 1) // 2
    at = np.arange(1, last + 1) * periods
    between = np.flatnonzero(np.arange(len(power)) % periods)
    between = between[between > periods // 2]
    levels = power[between]
    sums = np.concatenate([[0.0], np.cumsum(levels)])
    place = np.searchsorted(between, at)
    low, high = np.maximum(place - AROUND, 0), np.minimum(place + AROUND, len(levels))
    count = high - low
    ratio = power[at] / np.maximum((sums[high] - sums[low]) / count, 1e-300)
    m = float(count.mean())
    mean, single = m / (m - 1), m**2 / ((m - 1) ** 2 * (m - 2)) * (m - 1 + 1)
    shared = min(1.0 * last, 2 * AROUND / max(periods - 1, 1))  # neighbours that harmonics have in common
    variance = last * single + last * shared * mean**2 / m
    total = float(ratio.sum())
    shape = (last * mean) ** 2 / variance
    p_sum = float(gamma.sf(total, shape, scale=variance / (last * mean)))
    p_most = float(min(1.0, last * f.sf(ratio.max(), 2, 2 * m)))
    above = np.maximum(ratio - 1, 0.0)
    odd = float(above[::2].sum() / above.sum()) if above.sum() > 0 else 0.5
    return Repeating(total / (last * mean), min(1.0, 2 * min(p_sum, p_most)), np.arange(1, last + 1.0), ratio, odd)
