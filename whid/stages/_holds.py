"""Constant levels in a signal, exact or under noise; and the least significant bit it was quantised with."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from whid.signal import Floats, Ints

SHORTEST = 8  # samples of an exact level
WINDOW = 8  # samples before and after a change under noise; a noisy level has at least twice as many
SCORE = 6.0  # a change of the window mean by so many standard errors is a step
QUIET = 0.03  # of the signal's range: more scatter than this is no level
WHITE = 0.5  # von Neumann ratio below which the scatter is a slope, not noise
LONG = 40  # samples: a noisy level that is not between two steps is believed from here on
LOOKED_AT = 10**6  # samples from which the bit is found


class Stretch(NamedTuple):
    """Samples start … stop − 1."""

    start: int
    stop: int


def least_bit(x: Floats) -> float:
    """Return the step that all values are multiples of, apart from a common offset; 0 where there is none.

    >>> least_bit(np.array([0.5, 0.75, 0.5, 1.5])), least_bit(np.sin(np.arange(9.0)))
    (0.25, 0.0)
    """
    values = np.unique(x[:LOOKED_AT])
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * max(np.ptp(values), 1e-300)]
    if not len(gaps):
        return 0.0
    bit = float(gaps.min())
    multiples = gaps / bit
    return bit if np.all(np.abs(multiples - np.rint(multiples)) < 0.02 * np.maximum(1, multiples / 10)) else 0.0


def find_holds(u: Floats, bit: float) -> list[Stretch]:
    """Return the stretches where u is constant, noise of a few bits (or a few per cent of the range) allowed."""
    exact, scatter = _runs(u), QUIET * float(np.ptp(u))
    noisy = _merged(u, [piece for hold in _between_changes(u) for piece in constant(u, hold, bit, 0, scatter)], bit)
    if exact and not _flickers(u, exact, bit) and _samples(exact) >= 0.9 * _samples(noisy):
        return exact
    return [hold for hold in noisy if believed(u, hold, bit)]


def believed(u: Floats, hold: Stretch, bit: float) -> bool:
    """Tell whether a noisy level is long, or short but between two steps."""
    return hold.stop - hold.start >= LONG or all(steps(u, hold, bit))


def steps(u: Floats, hold: Stretch, bit: float) -> tuple[bool, bool]:
    """Tell whether a level is entered and left by a step: more than noise, more than the signal moves just outside.

    The ends of the record count as steps.
    """
    level, noise = u[hold.start : hold.stop].mean(), u[hold.start : hold.stop].std()
    outside = u[max(0, hold.start - WINDOW) : hold.start][::-1], u[hold.stop : hold.stop + WINDOW]
    found = []
    for x in outside:
        step, drift = (abs(x[:3].mean() - level), abs(x[-3:].mean() - x[:3].mean())) if len(x) >= 3 else (np.inf, 0.0)
        found.append(bool(step > max(3 * bit, 4 * noise) and step > 2 * drift))
    return found[0], found[1]


def _samples(holds: list[Stretch]) -> int:
    return sum(hold.stop - hold.start for hold in holds)


def _runs(u: Floats) -> list[Stretch]:
    edges = np.flatnonzero(np.abs(np.diff(u)) > 1e-12 * np.ptp(u)) + 1
    starts, stops = np.concatenate([[0], edges]), np.concatenate([edges, [len(u)]])
    long = stops - starts >= SHORTEST
    return [Stretch(int(a), int(b)) for a, b in zip(starts[long], stops[long], strict=True)]


def _flickers(u: Floats, runs: list[Stretch], bit: float) -> bool:
    """Tell whether the signal leaves a level for a few samples, by a bit or two, and returns: noise."""
    for (a, b), (c, _) in pairwise(runs):
        inside = u[b:c]
        back = abs(u[a] - u[c]) <= 1.01 * bit
        if 0 < len(inside) < 4 * SHORTEST and back and np.all(np.abs(inside - u[a]) <= 2.5 * bit):
            return True
    return False


def _between_changes(u: Floats) -> Iterator[Stretch]:
    """Yield the stretches between significant changes of the windowed mean."""
    n, w = len(u), WINDOW
    if n < 4 * w:
        yield Stretch(0, n)
        return
    x = u - u.mean()
    sums, squares = (np.concatenate([[0.0], np.cumsum(values)]) for values in (x, x * x))
    mean, square = (sums[w:] - sums[:-w]) / w, (squares[w:] - squares[:-w]) / w
    variance = np.maximum(square - mean**2, 0.0) + (1e-7 * np.ptp(u)) ** 2
    score = np.abs(mean[w:] - mean[:-w]) / np.sqrt((variance[w:] + variance[:-w]) / (w - 1))
    change = np.flatnonzero(score > SCORE)
    if len(change):  # of several changes within a window only the strongest
        groups = np.split(change, np.flatnonzero(np.diff(change) > 1) + 1)
        change = np.array([peak for group in groups for peak in _peaks(score, group)])
    edges = [0, *(change + w), n]
    yield from (Stretch(int(a), int(b)) for a, b in pairwise(edges) if b - a >= 2 * w)


def _peaks(score: Floats, group: Ints) -> list[int]:
    """Return the local maxima of a run of significant scores, no two within one window."""
    peaks: list[int] = []
    values = score[group].copy()
    while values.max() > 0:
        k = int(values.argmax())
        peaks.append(int(group[k]))
        values[max(0, k - WINDOW) : k + WINDOW + 1] = 0.0
        if len(group) > 64 * WINDOW:  # a long run is no staircase: its holds would not survive anyway
            return [int(group[0]), int(group[-1])]
    return sorted(peaks)


def constant(u: Floats, hold: Stretch, bit: float, depth: int = 0, scatter: float | None = None) -> list[Stretch]:
    """Return the constant pieces of a stretch: itself, or what a cumulative sum splits it into."""
    scatter = QUIET * float(np.ptp(u)) if scatter is None else scatter
    x = u[hold.start : hold.stop]
    n = len(x)
    if n < 2 * WINDOW or depth > 20:
        return []
    deviation = x - x.mean()
    spread = float(np.sqrt(np.mean(deviation**2)))
    noise = float(np.sqrt(np.mean(np.diff(x) ** 2) / 2))
    if spread <= 0.6 * bit or spread <= 1e-9 * scatter:
        return [hold]
    k = np.arange(1, n)
    jump = np.abs(np.cumsum(deviation)[:-1]) / np.sqrt(k * (n - k) / n)
    at = int(jump.argmax()) + 1
    if jump[at - 1] > SCORE * max(noise, 0.3 * bit):
        sides = Stretch(hold.start, hold.start + at), Stretch(hold.start + at, hold.stop)
        return [piece for side in sides for piece in constant(u, side, bit, depth + 1, scatter)]
    white = noise**2 >= WHITE * spread**2
    return [hold] if white and spread <= max(scatter, 2 * bit) else []


def _merged(u: Floats, holds: list[Stretch], bit: float) -> list[Stretch]:
    """Join neighbours whose means differ by no more than a bit or their own standard errors."""
    merged: list[Stretch] = []
    for hold in holds:
        if merged and hold.start - merged[-1].stop <= 2:
            a, b = u[slice(*merged[-1])], u[slice(*hold)]
            error = np.sqrt(a.var() / len(a) + b.var() / len(b))
            if abs(a.mean() - b.mean()) <= max(1.01 * bit, 4 * error):
                merged[-1] = Stretch(merged[-1].start, hold.stop)
                continue
        merged.append(hold)
    return merged
