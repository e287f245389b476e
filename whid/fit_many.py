"""Descents from many starts of one small least-squares problem, side by side.

A search over starts and orders makes hundreds of steps on a few dozen residuals: what they cost is the calls, not the
arithmetic, and side by side they cost one. `fit.least_squares` finishes the best of them: its estimate, covariance and rank.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RIDGE = 1e-13  # of a scaled matrix of products: below, columns count as dependent
GAIN = 1e-6  # χ² that an undamped step would still take, a thousandth of a standard error: less is the minimum
ROUNDING = 1e-13  # of χ²: the same, where χ² is large
MISFIT = 3.0  # χ² a residual: beyond, a start is far from the data
CREEPS = 0.01, 8  # of χ² a step, steps: a start that gains less, that often in a row, far from the data, is given up
LATE = 0.03, 4  # the same once another start has come to a minimum that is near them


class Descents(NamedTuple):
    """Where every start of B ended."""

    theta: Floats  # (B, p)
    chi2: Floats  # (B,)
    converged: NDArray[np.bool_]  # (B,) else it ran into the limit of iterations, crept, or a step gained nothing


def descents(
    linearised: Callable[[Floats], tuple[Floats, Floats]],
    starts: Floats,
    moving: NDArray[np.bool_],
    lower: Floats,
    most: int,
) -> Descents:
    """Minimise Σ r(θ)² from each start by Levenberg-Marquardt with Nielsen's damping, as `fit.minimise` does from one.

    linearised(θ (b, p)) → residuals (b, m), in standard deviations, and tangents (b, m, p), of any b; starts (B, p), of
    which those numbers that are not `moving` (B, p) stay; lower (p,) bounds; most: iterations.

    >>> def linearised(theta):
    ...     t = np.arange(5.0)
    ...     value = np.exp(-theta * t)
    ...     return 100 * (value - np.exp(-0.3 * t)), (-100 * t * value)[..., None]
    >>> descents(linearised, np.array([[1.0], [0.1]]), np.ones((2, 1), bool), np.array([-np.inf]), 30).theta.round(9)
    array([[0.3],
           [0.3]])
    """
    with np.errstate(all="ignore"):
        return _descents(linearised, np.where(moving, np.maximum(starts, lower), starts), moving, lower, most)


def _descents(
    linearised: Callable[[Floats], tuple[Floats, Floats]],
    theta: Floats,
    moving: NDArray[np.bool_],
    lower: Floats,
    most: int,
) -> Descents:
    ends = Descents(theta.copy(), np.full(len(theta), np.inf), np.zeros(len(theta), bool))
    at = _Linear.of(*linearised(theta))
    under_way = np.arange(len(theta))
    far, idle, (slow, patience) = MISFIT * at.residuals, np.zeros(len(theta), int), CREEPS
    mu, nu, shrink = np.full(len(theta), 1e-3), np.full(len(theta), 2.0), np.full(len(theta), 1 / 3)
    lower = np.where(moving, lower, -np.inf)
    for _ in range(most):
        held = ~moving | ((theta <= lower) & (at.slope > 0))
        plain, damped, gain = at.steps(held, mu)
        there = gain <= np.maximum(GAIN, ROUNDING * at.chi2)
        trial = np.maximum(theta + np.where(there[:, None], plain, damped), lower)
        moved = trial - theta
        still = (np.abs(moved) <= 1e-15 * np.abs(theta) + 1e-30).all(axis=1)
        new = _Linear.of(*linearised(trial))
        better = new.chi2 < at.chi2  # NaN is not
        predicted = -np.einsum("bi,bi->b", moved, 2 * at.slope + (at.products @ moved[..., None])[..., 0])
        creeps = (at.chi2 > far) & ~(new.chi2 < (1 - slow) * at.chi2)
        idle = np.where(creeps, idle + 1, 0)
        ratio = np.where(predicted > 0, (at.chi2 - new.chi2) / predicted, 1.0)
        mu = np.where(better, mu * np.maximum(shrink, 1 - (2 * ratio - 1) ** 3), mu * nu)
        shrink = np.where(better, np.maximum(shrink / 3, 1 / 27), 1 / 3)
        nu = np.where(better, 2.0, 2 * nu)
        theta = np.where(better[:, None], trial, theta)
        at = at.where(better, new)
        over = there | still | (mu > 1e12) | (idle >= patience)
        if over.any():
            slow, patience = LATE if (there & (at.chi2 <= far)).any() else (slow, patience)
            ends.theta[under_way[over]], ends.chi2[under_way[over]] = theta[over], at.chi2[over]
            ends.converged[under_way[over]] = there[over]
            on = ~over
            kept = (under_way, theta, moving, lower, idle, mu, nu, shrink)
            under_way, theta, moving, lower, idle, mu, nu, shrink = (x[on] for x in kept)
            at = at.those(on)
            if not len(under_way):
                break
    ends.theta[under_way], ends.chi2[under_way] = theta, at.chi2
    return ends._replace(chi2=np.where(np.isfinite(ends.chi2), ends.chi2, np.inf))


class _Linear(NamedTuple):
    """Problems linearised where they stand."""

    chi2: Floats  # (b,)
    slope: Floats  # (b, p) half the gradient
    products: Floats  # (b, p, p) JᵀJ
    residuals: int

    @classmethod
    def of(cls, residual: Floats, tangent: Floats) -> _Linear:
        across = np.swapaxes(tangent, -1, -2)
        chi2 = np.einsum("bm,bm->b", residual, residual)
        return cls(chi2, (across @ residual[..., None])[..., 0], across @ tangent, residual.shape[1])

    def those(self, which: NDArray[np.bool_]) -> _Linear:
        """Return some of them."""
        return _Linear(self.chi2[which], self.slope[which], self.products[which], self.residuals)

    def where(self, better: NDArray[np.bool_], other: _Linear) -> _Linear:
        """Return `other` where that is better."""
        if better.all():
            return other
        return _Linear(
            np.where(better, other.chi2, self.chi2),
            np.where(better[:, None], other.slope, self.slope),
            np.where(better[:, None, None], other.products, self.products),
            self.residuals,
        )

    def steps(self, held: NDArray[np.bool_], mu: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the undamped and the damped step, and what the first would take from χ²."""
        own = np.einsum("bii->bi", self.products)
        inverse = np.where(held | ~(own > 0), 0.0, 1 / np.sqrt(own))
        both = np.empty((2, *self.products.shape))
        np.multiply(self.products, inverse[:, :, None] * inverse[:, None, :], out=both[0])
        target = -self.slope * inverse
        n = np.arange(both.shape[-1])
        both[0][:, n, n] = 1.0 + RIDGE
        both[1] = both[0]
        both[1][:, n, n] += mu[:, None]
        finite = np.isfinite(both.sum(axis=(0, 2, 3)) + target.sum(axis=1))
        if not finite.all():
            both[:, ~finite], target = np.eye(len(n)), np.where(finite[:, None], target, 0.0)
        found = np.linalg.solve(both, np.broadcast_to(target, (2, *target.shape))[..., None])[..., 0]
        return found[0] * inverse, found[1] * inverse, np.einsum("bi,bi->b", found[0], target)
