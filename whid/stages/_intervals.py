"""The cheapest way to cut a curve into polynomial pieces, over all ways there are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats


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

    All intervals of one length are projected at once on orthonormal polynomials; this only ranks, `_junctions.joint` fits.
    """
    count = len(z)
    cost, chosen = np.full((count, count + 1), np.inf), np.zeros((count, count + 1), np.intp)
    for size in range(1, count + 1):
        rows = np.arange(count - size + 1)[:, None] + np.arange(size)
        degree = min(max_degree, size - 1)
        local = z[rows] - z[rows].mean(axis=1, keepdims=True)
        local /= np.maximum(np.abs(local).max(axis=1, keepdims=True), 1e-300)
        weight = 1 / std[rows]
        columns = [weight]
        for _ in range(degree):
            columns.append(columns[-1] * local)
        basis = np.linalg.qr(np.stack(columns, axis=-1))[0]
        left = (mean[rows] - mean[rows].mean(axis=1, keepdims=True)) * weight
        totals = np.empty((degree + 1, len(rows)))
        for d in range(degree + 1):  # subtract one direction at a time: no cancellation of large sums
            left = left - basis[:, :, d] * np.einsum("ij,ij->i", basis[:, :, d], left)[:, None]
            totals[d] = np.einsum("ij,ij->i", left, left) + price * (d + 2)
        start = rows[:, 0]
        chosen[start, start + size] = totals.argmin(axis=0)
        cost[start, start + size] = totals.min(axis=0)
    return cost, chosen
