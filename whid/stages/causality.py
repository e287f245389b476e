"""Which of two columns moves first, and so whether input and output are swapped."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np

from whid.quantity import Quantity
from whid.signal import Floats

LAGS = 20
LONGEST = 200_000  # samples that are looked at
SMALL = 1e-9  # p of "no correlation" below which there is some
DOMINANT = 10.0  # how many times the one direction must outweigh the other
PREDICTABLE = 1e-5  # innovation variance / variance below which a column is a periodic signal: no arrow of time


class Causality(NamedTuple):
    """Squared correlations between one column's innovations and the other column's past."""

    input_follows: Annotated[float, Quantity()]  # N Σ c², c between the input's innovations and earlier … later
    output_follows: Annotated[float, Quantity()]
    p: Annotated[float, Quantity()]  # of the larger one, χ² with LAGS degrees of freedom
    verdict: Literal["as declared", "swapped", "cannot tell"]


def causality(u: Floats, y: Floats) -> Causality:
    """Tell whether y follows u or u follows y.

    Prewhitened cross-correlation [Box, Jenkins, Time Series Analysis, ch. 11]: an autoregression turns x into
    innovations e_x and filters the other column z into z_f; what has an effect is uncorrelated with the past of what
    it affects, so S_x = N Σ_{k=1…20} corr(e_x(n), z_f(n − k))² is χ²₂₀ when x is the cause. Swapped: S_u is
    significant and ten times S_y. Periodic or closed-loop data give "cannot tell".

    u, y (N,), any units.

    >>> u = np.random.default_rng(1).standard_normal(2000)
    >>> y = np.convolve(u, np.append(0.0, 0.7 ** np.arange(20)))[:2000]
    >>> causality(u, y).verdict, causality(y, u).verdict
    ('as declared', 'swapped')
    """
    from scipy.special import chdtrc

    u, y = u[:LONGEST], y[:LONGEST]
    before_u, before_y = _precedes(u, y), _precedes(y, u)
    p = float(chdtrc(LAGS, np.nan_to_num(max(before_u, before_y))))
    clear = min(before_u, before_y) * DOMINANT <= max(before_u, before_y)  # false when one of them is NaN
    if p > SMALL or not clear:
        return Causality(before_u, before_y, p, "cannot tell")
    return Causality(before_u, before_y, p, "swapped" if before_u > before_y else "as declared")


def _precedes(x: Floats, other: Floats) -> float:
    """Return N Σ corr(e_x(n), other_f(n − k))², k = 1 … LAGS: large when the other column moves before x."""
    whitened = whiten(x, other)
    if whitened is None:
        return float("nan")
    e, z = whitened
    e, z = (e - e.mean()) / e.std(), (z - z.mean()) / z.std()
    return float(sum((e[k:] @ z[:-k] / len(e)) ** 2 for k in range(1, LAGS + 1)) * len(e))


def whiten(x: Floats, other: Floats) -> tuple[Floats, Floats] | None:
    """Return both columns filtered by the autoregression that turns x into innovations; None for a predictable x."""
    from scipy.linalg import solve_toeplitz
    from scipy.signal import lfilter

    x, other = x - x.mean(), other - other.mean()
    n, order = len(x), min(LAGS, len(x) // 10)
    spectrum = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    covariance = np.fft.irfft(spectrum)[: order + 1] / n
    covariance[0] *= 1 + 1e-10
    if order == 0 or not (np.isfinite(covariance).all() and covariance[0] > 0):
        return None
    whitening = np.append(1.0, -solve_toeplitz(covariance[:-1], covariance[1:]))
    e, z = (np.asarray(lfilter(whitening, [1.0], column)[order:]) for column in (x, other))
    return (e, z) if e.var() > PREDICTABLE * x.var() and z.std() > 0 else None
