"""Visits of equal levels brought together: each level once, its branches apart or pooled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats
from whid.stages.levels import StaticCurve

SAME_LEVEL = 2e-4  # of the span: levels nearer than this are one level visited again


class Pooled(NamedTuple):
    """Weighted means by level, ascending."""

    level: Floats  # (M,)
    mean: Floats  # (M,)
    std: Floats  # (M,)
    chi2: float  # of the visits about their level's mean
    dof: int


def levels_of(curve: StaticCurve) -> NDArray[np.intp]:
    """Return which distinct level, ascending, each visit belongs to."""
    order = np.argsort(curve.level, kind="stable")
    new = np.diff(curve.level[order]) > SAME_LEVEL * np.ptp(curve.level)
    number = np.empty(len(order), np.intp)
    number[order] = np.append(0, np.cumsum(new))
    return number


def pooled(curve: StaticCurve, visits: NDArray[np.bool_] | None = None, extra: float = 0.0) -> Pooled:
    """Return the weighted mean of some visits of each level, each visit with an extra variance."""
    chosen = np.ones(len(curve.level), bool) if visits is None else visits
    number = np.unique(levels_of(curve)[chosen], return_inverse=True)[1]
    mean, variance = curve.mean[chosen], curve.mean_std[chosen] ** 2 + extra
    floor = (1e-12 * max(float(np.ptp(curve.mean)), 1e-300)) ** 2  # noise-free data keep finite weights
    weight = 1 / np.maximum(variance, floor)
    total = np.bincount(number, weight)
    average = np.bincount(number, weight * mean) / total
    level = np.bincount(number, curve.level[chosen]) / np.bincount(number)
    chi2 = float(np.sum(weight * (mean - average[number]) ** 2))
    return Pooled(level, average, 1 / np.sqrt(total), chi2, len(mean) - len(average))


def visit_variance(curve: StaticCurve, significance: float = 0.001) -> float:
    """Return the variance that visits of one level show beyond their standard errors, 0 where it is not significant.

    From Σ w (y − ȳ)² = dof + τ²(Σw − Σ_levels Σw²/Σw) [DerSimonian, Laird 1986].
    """
    from scipy.special import chdtrc

    found = pooled(curve)
    if found.dof == 0 or chdtrc(found.dof, found.chi2) >= significance:
        return 0.0
    number = levels_of(curve)
    equal = 1 / np.bincount(number)  # unweighted within a level: visits of unequal noise scatter alike
    square = np.sum((curve.mean - (np.bincount(number, curve.mean) * equal)[number]) ** 2)
    noise = np.sum(curve.mean_std**2 * (1 - equal[number]))
    return max(0.0, float((square - noise) / found.dof))
