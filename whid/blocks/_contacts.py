"""Where an output between two borders is held and where it follows one, run by run, without a loop over samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whid.signal import Floats, Ints

FALLING, RISING = 0, 1  # rows of a table of borders
TOLERANCE = 1e-12  # of 1 + |border|: as near as this the output is on the border (a static curve has to stay on it)


class Followed(NamedTuple):
    """The output at every knot; source is the knot whose border value it is, itself where it follows, −1 before any."""

    w: Floats  # (K,)
    source: Ints  # (K,)
    side: Ints  # (K,) FALLING or RISING: the border that the run before the knot goes towards


def border(table: Floats, side: Ints, x: Floats) -> Floats:
    """Return the polynomial `table[side]` (ascending coefficients) at x (…, m), one side (m,) a column.

    >>> border(np.array([[0.5, 1.0], [-0.5, 1.0]]), np.array([RISING, FALLING]), np.array([2.0, 2.0]))
    array([1.5, 2.5])
    """
    result = np.broadcast_to(table[:, -1].take(side), x.shape).copy()
    for coefficients in table.T[-2::-1]:
        result *= x
        result += coefficients.take(side)
    return result


def follow(x: Floats, w0: float, heading: float, table: Floats) -> Followed:
    """Return the output at the knots x[1:], monotone in between, when it is w0 at x[0] and x has been going `heading`.

    On a run of x in one direction the output holds until the first knot, the run's start included, at which border − w is
    zero or has changed sign, then follows the border to the run's end; without contact it is held into the next run.
    So a run has a contact where w lies within the range of the border over it, and then ends on the border whatever w was:
    three numbers a run, and what happens is a glance at each in turn.

    >>> follow(np.array([0.0, 1.0, 0.0, -1.0]), 0.0, 0.0, np.array([[0.3, 1.0], [-0.3, 1.0]])).w
    array([ 0.7,  0.3, -0.7])
    """
    count = len(x) - 1
    going = _direction(np.sign(np.diff(x)), heading)
    side = (going > 0).astype(np.intp)
    starts = np.append(0, np.flatnonzero(going[1:] != going[:-1]) + 1)
    length = np.diff(np.append(starts, count))
    reach, begin = border(table, side, x[1:]), border(table, side[starts], x[starts])
    held = _held(starts, begin, reach, w0, skip=going[0] == 0)
    before, after = _sign(begin, held), _sign(reach, np.repeat(held, length))
    hit = np.flatnonzero((after * np.repeat(before, length) <= 0) & (going != 0))[::-1]
    contact, run, knots = np.full(len(starts), count), np.repeat(np.arange(len(starts)), length), np.arange(count)
    contact[run[hit]] = hit  # backwards: the first contact of a run is written last
    source = np.maximum.accumulate(np.where(knots >= contact[run], knots, -1))
    return Followed(np.where(source >= 0, reach[source], w0), source, side)


def _held(starts: Ints, begin: Floats, reach: Floats, w: float, *, skip: bool) -> Floats:
    """Return the output at the start of every run; `skip`: the first is no run, x rests."""
    low, high = np.minimum(begin, np.minimum.reduceat(reach, starts)), np.maximum(begin, np.maximum.reduceat(reach, starts))
    low, high = low - TOLERANCE * (1 + np.abs(low)), high + TOLERANCE * (1 + np.abs(high))
    low[: int(skip)] = np.inf
    end = reach[np.append(starts[1:], len(reach)) - 1]
    held = []
    for a, b, c in zip(low.tolist(), high.tolist(), end.tolist(), strict=True):
        held.append(w)
        if a <= w <= b:
            w = c
    return np.array(held)


def touching(table: Floats, side: Ints, x: Floats, w: Floats) -> np.ndarray:
    """Tell where the output is on a border."""
    return np.asarray(_sign(border(table, side, x), w) == 0)


def _direction(moves: Floats, heading: float) -> Floats:
    """Return where x is going at every knot: at rest as before."""
    latest = np.maximum.accumulate(np.where(moves != 0, np.arange(len(moves)), -1))
    return np.where(latest >= 0, moves[latest], heading)


def _sign(reach: Floats, w: Floats) -> Floats:
    return np.where(np.abs(reach - w) <= TOLERANCE * (1 + np.abs(reach)), 0.0, np.sign(reach - w))
