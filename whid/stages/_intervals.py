"""The cheapest way to cut a curve into polynomial pieces, over all ways there are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats

ROOM = 1 << 12  # numbers that are looked at together


def intervals(
    z: Floats, mean: Floats, std: Floats, max_degree: int, price: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the cheapest cuts and degrees by dynamic programming."""
    count = len(z)
    cost, degree = _costs(z, mean, std, max_degree, price)
    best, come = np.append(0.0, np.full(count, np.inf)), np.zeros(count + 1, np.intp)
    for stop in range(1, count + 1):
        total = best[:stop] + cost[:stop, stop]
        come[stop] = np.argmin(total)
        best[stop] = total[come[stop]]
    cuts = [count]
    while cuts[0]:
        cuts.insert(0, int(come[cuts[0]]))
    return np.array(cuts[1:-1], np.intp), np.array([degree[a, b] for a, b in pairwise(cuts)], np.intp)


def _costs(z: Floats, mean: Floats, std: Floats, max_degree: int, price: float) -> tuple[Floats, NDArray[np.intp]]:
    """Return the cheapest χ² + price·(degree + 2) of the levels start … stop − 1, and its degree, as [start, stop].

    Intervals of many lengths are projected at once on orthonormal polynomials, made by their recursion of three terms; this
    only ranks, `_junctions.joint` fits.
    """
    count = len(z)
    cost, chosen = np.full((count, count + 1), np.inf), np.zeros((count, count + 1), np.intp)
    longest = 0
    while longest < count:
        shortest = longest + 1
        longest = min(count, longest + 1 + ROOM // (count * shortest))
        sizes = np.arange(shortest, longest + 1)
        size = np.repeat(sizes, count - sizes + 1)
        start = np.concatenate([np.arange(count - size + 1) for size in sizes])
        totals = _left_over(z, mean, 1 / std, start, size, max_degree) + price * np.arange(2, max_degree + 3)[:, None]
        chosen[start, start + size] = totals.argmin(axis=0)
        cost[start, start + size] = totals.min(axis=0)
    return cost, chosen


def _left_over(
    z: Floats, mean: Floats, weight: Floats, start: NDArray[np.intp], size: NDArray[np.intp], max_degree: int
) -> Floats:
    """Return χ² of a polynomial of every degree on each interval, (degree + 1, I), ∞ beyond its levels."""
    place = np.arange(size.max())
    inside = place < size[:, None]
    rows = np.minimum(start[:, None] + place, len(z) - 1)
    weights = np.where(inside, weight[rows], 0.0)

    def centred(values: Floats) -> Floats:
        own = np.where(inside, values[rows], 0.0)
        return np.asarray(own - own.sum(axis=1, keepdims=True) / size[:, None])

    def along(a: Floats, b: Floats) -> Floats:
        return np.asarray(np.einsum("ij,ij->i", a, b)[:, None])

    local = np.where(inside, centred(z), 0.0)
    local /= np.maximum(np.abs(local).max(axis=1, keepdims=True), 1e-300)
    left, before, now = centred(mean) * weights, np.zeros_like(weights), weights
    found = np.full((max_degree + 1, len(size)), np.inf)
    for degree in range(max_degree + 1):
        if degree:
            following = local * now
            following -= now * along(now, following)
            following -= before * along(before, following)
            before, now = now, following
        now = now / np.sqrt(np.maximum(along(now, now), 1e-300))
        left = left - now * along(now, left)  # one direction at a time: no cancellation of large sums
        found[degree] = np.where(size > degree, along(left, left)[:, 0], np.inf)
    return found
