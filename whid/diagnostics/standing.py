"""Samples that repeat the one before where nothing should: on the raw output, before any model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats

Bools = NDArray[np.bool_]
RUN = 3  # equal values in a row that noise does not make
PAIRS = 20  # changes with the input held, from which the noise is seen
TURNING = 0.4  # of them turn back: noise does in two of three, what settles does not
COARSE = 0.05  # of pairs equal by chance: a coarse lattice repeats itself without hanging
MANY = 0.2  # of pairs equal, however: so often no sensor hangs
CLUSTERED = 4.0  # times as likely where the output is slow
CHANCE = 1e-3  # that a record has one run as long as those that count


def standing(y: Floats) -> Bools:
    """Return where a sample equals the one before, (N,); never the first, never beside a missing one.

    >>> standing(np.array([1.0, 1.0, 2.0, np.nan, 2.0])).astype(int)
    array([0, 1, 0, 0, 0])
    """
    return np.append(False, np.diff(y) == 0)


def telling(y: Floats, u: Floats) -> Bools:
    """Return where a repetition would say something, (N,): the input moved, or noise is seen while the input stands.

    Without noise, an output at rest repeats itself under a held input whatever the sensor does.

    >>> rng = np.random.default_rng(0)
    >>> held = np.repeat([0.0, 1.0, 0.0, 1.0], 50)
    >>> telling(held, held).sum(), telling(held + rng.normal(size=200), held).sum()
    (np.int64(3), np.int64(199))
    """
    change = np.append(np.nan, np.diff(y))
    moved, known = np.append(False, np.diff(u) != 0), np.isfinite(change)
    two = known[1:] & known[:-1] & ~moved[1:] & ~moved[:-1] & (change[1:] != 0) & (change[:-1] != 0)
    turns = np.sign(change[1:]) != np.sign(change[:-1])
    seen = two.sum() >= PAIRS and turns[two].mean() >= TURNING
    return np.asarray(known if seen else known & moved)


def frozen(y: Floats, u: Floats, use: Bools) -> Bools:
    """Return where a sensor hangs: in runs of equal values that tell something, the rails left out.

    A run counts from RUN values on, and from as many as chance would not make once a record: a share c of all pairs is equal
    without a third, so N·(CLUSTERED·c)^(length − 1) < CHANCE. A value that two runs share is the plant's own.

    >>> y = np.array([9.0, 1.0, 2.0, 2.0, 2.0, 3.0, 0.0, *np.arange(0.1, 8, 0.1)])
    >>> frozen(y, np.arange(86.0), np.ones(86, bool))[:7].astype(int)
    array([0, 0, 0, 1, 1, 0, 0])
    """
    known = np.where(use, y, np.nan)
    same = standing(known)
    found = np.zeros(len(y), bool)
    if not same.any():
        return found
    ends = (np.nanmax(known), np.nanmin(known))
    spans = [(a, b) for a, b in runs(same) if known[a] not in ends]
    pairs = int(np.isfinite(np.diff(known)).sum())
    chance = CLUSTERED * sum(b - a == 1 for a, b in spans) / pairs
    if chance > CLUSTERED * COARSE or sum(b - a for a, b in spans) > MANY * pairs:
        return found
    longest = RUN - 1 if chance == 0 else max(RUN - 1, int(np.ceil(np.log(CHANCE / pairs) / np.log(chance))))
    tells = telling(known, u)
    spans = [
        (a, b) for a, b in spans if b - a >= longest and tells[a:b].mean() > 0.5 and a > 1 and np.isfinite(known[a - 2])
    ]
    values = [known[a] for a, _ in spans]
    for a, b in spans:
        found[a:b] = values.count(known[a]) == 1
    return found


def runs(hit: Bools) -> NDArray[np.intp]:
    """Return where stretches of True begin and end, (count, 2), half-open.

    >>> runs(np.array([True, True, False, True])).tolist()
    [[0, 2], [3, 4]]
    """
    return np.flatnonzero(np.diff(hit.astype(int), prepend=0, append=0)).reshape(-1, 2)
