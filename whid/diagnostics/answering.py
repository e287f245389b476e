"""Does the residual answer to the input: a regression on past inputs and outputs, straight and bent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats
from whid.stages._whiten import autoregression, whitened

LAGS = (0, 1, 2, 4, 8, 16)
POWERS = (1, 2, 3)


class Answering(NamedTuple):
    """How much of a residual past inputs and outputs explain.

    statistic  χ² over its degrees of freedom: 1 when nothing answers
    strongest  the regressor that explains most by itself, in words
    """

    statistic: float
    p: float
    strongest: str


def answering(residual: Floats, use: NDArray[np.bool_], signals: dict[str, Floats], base: Floats | None = None) -> Answering:
    """Regress a residual, whitened by its own autoregression, on lagged powers of signals; heteroscedastic χ² [White 1980].

    residual (N,), use (N,) where it counts, signals by name (N,); base (N, p): what the model's free numbers absorb anyway,
    taken out of the regressors. χ² = sᵀV⁻¹s, s = Xᵀe, V = Xᵀdiag(e²)X: right for noise whose size varies, and the whitening
    makes it right for coloured noise.

    >>> rng = np.random.default_rng(1)
    >>> u, e = rng.standard_normal((2, 4000))
    >>> on = np.ones(4000, bool)
    >>> answering(e, on, {"u": u}).p > 0.01, answering(e + 0.2 * u**2, on, {"u": u}).strongest
    (True, 'u^2, 0 samples earlier')
    """
    from scipy.stats import chi2

    names, columns = [], []
    for name, x in signals.items():
        size = float(np.std(x[use])) or 1.0
        scaled = (x - float(np.mean(x[use]))) / size
        for power in POWERS:
            for lag in LAGS:
                names.append(f"{name}^{power}, {lag} samples earlier" if power > 1 else f"{name}, {lag} samples earlier")
                columns.append(np.concatenate([np.full(lag, scaled[0]), scaled[: len(scaled) - lag]]) ** power)
    ar = autoregression(np.where(use, residual, 0.0), use)
    design = [np.column_stack(columns)] if base is None else [np.column_stack(columns), base]
    rows = np.column_stack([np.where(use, residual, 0.0), *design])
    white = whitened(np.where(use[:, None], rows, 0.0), use, ar)[use]
    e, x = white[:, 0], white[:, 1 : 1 + len(columns)]
    absorbed = np.column_stack([np.ones(len(e)), white[:, 1 + len(columns) :]])
    both = _rest(np.column_stack([e, x]), absorbed)
    e, x = both[:, 0], _independent(both[:, 1:])
    if not x.shape[1]:
        return Answering(0.0, 1.0, "nothing")
    scores = x.T @ e
    weighted = x * e[:, None]
    statistic = float(scores @ np.linalg.solve(weighted.T @ weighted, scores))
    single = (both[:, 1:].T @ both[:, 0]) ** 2 / np.maximum(np.sum(both[:, 1:] ** 2, axis=0), 1e-300)
    return Answering(statistic / x.shape[1], float(chi2.sf(statistic, x.shape[1])), names[int(np.argmax(single))])


def _rest(rows: Floats, absorbed: Floats) -> Floats:
    q = _independent(absorbed)
    return np.asarray(rows - q @ (q.T @ rows))


def _independent(x: Floats) -> Floats:
    """Return orthonormal columns that span those of x, near-dependent ones left out."""
    size = np.linalg.norm(x, axis=0)
    scaled = x[:, size > 0] / size[size > 0]
    if not scaled.shape[1]:
        return np.asarray(scaled, float)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    kept = values > 1e-6 * values.max()
    return np.asarray(scaled @ (vectors[:, kept] / np.sqrt(values[kept])))
