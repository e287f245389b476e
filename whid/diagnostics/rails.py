"""The ends of a sensor's range: an extreme that is met again and again, to the last digit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whid.diagnostics.standing import Bools, runs, standing, telling
from whid.signal import Floats

LEAST = 5  # repetitions
OFTEN = 3.0  # times as often as any value between the ends
MOST = 0.3  # of neighbours equal between the ends: more, and repetitions say nothing
STEEP = 3.0  # finest steps of the values: what lies that close beside a run may be the top of a smooth wave


class Rail(NamedTuple):
    """One end of the range.

    level  where it is; error: half of the finest step between values, over √3
    at     (N,) the samples there
    nats   log-likelihood of the repetitions over what neighbours do elsewhere
    """

    level: float
    error: float
    at: Bools
    nats: float


def rails(y: Floats, u: Floats, use: Bools) -> tuple[Rail | None, Rail | None]:
    """Return the lower and the upper rail of an output, None where there is none.

    A rail is an extreme that neighbours share exactly while the input moves (or while noise is seen under a held input), far
    more often than any other value is met, and from which the output leaves in more than the finest steps: the top of a
    smooth wave on a lattice does not. nats = pairs·log(1/chance), the chance of equal neighbours from all other pairs.

    >>> rng = np.random.default_rng(2)
    >>> y = rng.standard_normal(400)
    >>> low, high = rails(np.minimum(y, 1.5), y, np.ones(400, bool))
    >>> low is None, high.level, int(high.at.sum()), rails(y, y, np.ones(400, bool))
    (True, 1.5, 26, (None, None))
    """
    known = np.where(use, y, np.nan)
    return _end(-known, u, -1.0), _end(known, u, 1.0)


def _end(y: Floats, u: Floats, sign: float) -> Rail | None:
    values, counts = np.unique(y[np.isfinite(y)], return_counts=True)
    if len(values) < 3 or counts[-1] < LEAST or counts[-1] < OFTEN * counts[1:-1].max():
        return None
    at = y == values[-1]
    tells, same = telling(y, u), standing(y)
    elsewhere = np.append(False, np.isfinite(np.diff(y))) & ~at & (y != values[0])
    chance = float((same[elsewhere].sum() + 1) / (elsewhere.sum() + 2))
    if not tells[at].any() or chance > MOST:
        return None
    beside = np.array([abs(y[k] - values[-1]) for a, b in runs(at) for k in (a - 1, b) if 0 <= k < len(y)])
    step = float(np.diff(values).min())
    beside = beside[np.isfinite(beside)]
    if not len(beside) or np.median(beside) < max(STEEP * step, 1e-9 * float(values[-1] - values[0])):
        return None
    pairs = int((same & at & tells).sum())
    # single visits count too: the same last digit again is one of the many values that occur
    single = int(at.sum()) - pairs - 1
    return Rail(
        sign * float(values[-1]), step / np.sqrt(12), at, pairs * np.log(1 / chance) + single * np.log(len(values) / 2)
    )
