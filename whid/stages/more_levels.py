"""Which levels a static curve lacks: on pieces that too few levels describe, and what adding them will be worth."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from whid.signal import Floats
from whid.stages.bisection import row_of
from whid.stages.segmentation import Segmentation


class MoreLevels(NamedTuple):
    """Levels to add, and the standard errors of f there once they are."""

    level: Floats
    f_std: Floats


def more_levels(pieces: Segmentation, level: Floats, std: float, max_degree: int) -> MoreLevels:
    """Return the levels that pieces lack, without which their degree cannot be told.

    A piece needs levels at the `max_degree + 2` Gauss-Lobatto nodes from its first level to its last, or nearer to each than
    half way to the next; levels that crowd at a border are as good as one. Errors: the bound of Cramér and Rao of old and
    new levels together, pieces and kinks as read, C − CRᵀ(RCRᵀ + S)⁻¹RC with C the covariance now, R the new levels'
    derivatives, S = std² + visit_std² their own variances. level (M,) all levels now; std of a level.
    Source [PAPERS A, build 3].

    >>> from whid.stages.levels import level_means
    >>> from whid.stages.segmentation import segment
    >>> u = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    >>> rng = np.random.default_rng(1)
    >>> holds = [10.0 * (v > 0.5) + 0.1 * rng.normal(size=400) for v in u]
    >>> curve = level_means(holds, u, np.ones(5), 1.0, 0.0)
    >>> more_levels(segment(curve), curve.level, 0.005, 3).level.round(2)  # all on the right piece, two on the left
    array([-1.65, -0.35,  1.17,  1.5 ,  1.83])
    """
    ends = np.concatenate([[np.min(level)], pieces.borders.ravel(), [np.max(level)]]).reshape(-1, 2)
    added = np.concatenate([_lacking(low, high, level, max_degree + 2) for low, high in ends])
    if not len(added):
        return MoreLevels(added, added)
    under = np.searchsorted(pieces.breaks, added)
    rows = np.array([row_of(pieces, int(k), float(u))[0] for k, u in zip(under, added, strict=True)])
    now = rows @ pieces.estimate.covariance @ rows.T
    noise = (std**2 + pieces.visit_std**2) * np.eye(len(added))
    then = now - now @ np.linalg.solve(now + noise, now)
    return MoreLevels(added, np.sqrt(np.maximum(np.diag(then), 0.0)))


@lru_cache
def lobatto(count: int) -> Floats:
    """Return the `count` Gauss-Lobatto nodes on [−1, 1], both ends among them.

    >>> lobatto(5).round(4)
    array([-1.    , -0.6547,  0.    ,  0.6547,  1.    ])
    """
    inner = np.sort(np.polynomial.Legendre.basis(count - 1).deriv().roots().real)
    return np.concatenate([[-1.0], np.where(np.abs(inner) < 1e-12, 0.0, inner), [1.0]])


def _lacking(low: float, high: float, level: Floats, enough: int) -> Floats:
    """Return the nodes of one piece that are asked for, ascending."""
    own = level[(level >= low) & (level <= high)]
    if not high > low:
        return np.empty(0)
    nodes = (low + high) / 2 + (high - low) / 2 * lobatto(enough)
    reach = np.minimum(np.diff(nodes)[:-1], np.diff(nodes)[1:])
    away = np.min(np.abs(own[:, None] - nodes[1:-1]), axis=0) / reach
    return np.asarray(nodes[1:-1][away > 0.5])
