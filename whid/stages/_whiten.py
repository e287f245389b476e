"""An autoregressive noise model of a residual with holes, and the filter that makes such a residual white."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats
from whid.stages._noise import _autoregression, _lagged

Bools = NDArray[np.bool_]


def autoregression(residual: Floats, valid: Bools, max_order: int = 20) -> Floats:
    """Return a₁ … a_p of e(t) = Σ aₖ e(t − k) + innovation; Yule-Walker over the valid pairs, p by BIC.

    >>> rng = np.random.default_rng(0)
    >>> e = rng.normal(size=4000)
    >>> for t in range(1, 4000): e[t] += 0.8 * e[t - 1]
    >>> autoregression(e, np.ones(4000, bool)).round(1)
    array([0.8])
    """
    known = np.where(valid, residual, 0.0)
    order = min(max_order, max(len(known) // 10, 0)) + 1
    pairs = np.maximum(_lagged(valid.astype(float), order), 1.0)
    return _autoregression(_lagged(known, order) / pairs, pairs[0])[0]


def whitened(rows: Floats, valid: Bools, ar: Floats) -> Floats:
    """Return rows (n, c) filtered so that autoregressive noise in them becomes white, of its innovation's size.

    A row whose p predecessors are valid: rows(t) − Σ aₖ rows(t − k). After a hole the predictor of as many as there are,
    scaled by its own error: exact for every unbroken stretch.
    """
    p = len(ar)
    if not p:
        return rows
    run = _run(valid)
    out = np.zeros_like(rows)
    for order, (predictor, scale) in enumerate(_predictors(ar)):
        at = np.flatnonzero(valid & (run == order if order < p else run >= p))
        if not len(at):
            continue
        found = rows[at].copy()
        for k, a in enumerate(predictor, 1):
            found -= a * rows[at - k]
        out[at] = found * scale
    return out


def _run(valid: Bools) -> NDArray[np.intp]:
    """Return how many valid samples stand immediately before each one."""
    index = np.arange(len(valid))
    last_hole = np.maximum.accumulate(np.where(valid, -1, index))
    return np.asarray(index - np.append(-1, last_hole[:-1]) - 1)


def _predictors(ar: Floats) -> list[tuple[Floats, float]]:
    """Return the best predictors of order 0 … p and (innovation std)/(their error's std), by Levinson downwards."""
    found, scale, a = [(ar, 1.0)], 1.0, ar
    while len(a):
        reflection = a[-1]
        shrink = 1 - reflection**2
        a = (a[:-1] + reflection * a[-2::-1]) / shrink if len(a) > 1 else a[:0]
        scale *= np.sqrt(shrink)
        found.append((a, float(scale)))
    return found[::-1]
