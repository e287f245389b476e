"""The line of inputs cut into cells, and sums over the samples in every cell: a window is some cells next to each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats

FINE = 1 << 14  # steps of the table that tells an input's cell: it stays in the cache


class Grouped(NamedTuple):
    """Samples in the order of their cells."""

    order: NDArray[np.intp]  # (N,) their numbers
    present: NDArray[np.intp]  # cells that have any
    starts: NDArray[np.intp]  # where each of those begins
    counts: NDArray[np.intp]  # samples of each

    def until(self, cell: int) -> int:
        """Return how many samples lie in the cells below one."""
        return int(self.counts[: np.searchsorted(self.present, cell)].sum())


class Cells:
    """Cells between cuts, cell k from cuts[k − 1] to below cuts[k], the first and the last open; (C + 1,) for C cuts.

    Of every cell: Σ T_m to an order; of (1, o, z) the products of each two, o from the middle of the cell, z = y less
    the line of its first samples, so that nothing cancels; the smallest and largest input.

    >>> cells = Cells(np.array([-1.0, 0.0, 1.0]), 1)
    >>> cells.group(np.array([0.5, -0.5, -1.0, 2.0, 1.0])).order
    array([1, 2, 0, 3, 4])
    """

    def __init__(self, cuts: Floats, order: int) -> None:
        self.cuts = np.unique(cuts[np.isfinite(cuts)])
        n = len(self.cuts) + 1
        self.middles = np.concatenate([self.cuts[:1], (self.cuts[1:] + self.cuts[:-1]) / 2, self.cuts[-1:]])
        self.sums = np.zeros((6 + order, n))  # o, o², z, oz, z², T₀ …
        self.lines = np.zeros((2, n))  # value at the middle, and slope
        self.ends = np.tile([[np.inf], [-np.inf]], (1, n))
        self._tabulate()

    def _tabulate(self) -> None:
        """Prepare the cell of every step of a fine table; steps with a cut in or beside them are looked up exactly."""
        kind = np.uint8 if len(self.cuts) < np.iinfo(np.uint8).max else np.uint16
        self._unsure = np.iinfo(kind).max
        self._step = max(float(np.ptp(self.cuts)), 1e-12) / (FINE - 8)
        self._low = float(self.cuts[0]) - 4 * self._step
        table = np.searchsorted(self.cuts, self._low + self._step * np.arange(FINE), side="right").astype(kind)
        cut = ((self.cuts - self._low) / self._step).astype(np.intp)
        for beside in (-1, 0, 1):
            table[cut + beside] = self._unsure
        self._table = table

    def group(self, t: Floats) -> Grouped:
        """Return the order of samples (N,) by their cells."""
        place = t - self._low
        place *= 1 / self._step
        np.maximum(place, 0, out=place)
        np.minimum(place, FINE - 1, out=place)
        cell = self._table.take(place.astype(np.intp), mode="clip")
        unsure = np.flatnonzero(cell == self._unsure)
        cell[unsure] = np.searchsorted(self.cuts, t[unsure], side="right")
        counts = np.bincount(cell, minlength=len(self.middles))
        present = np.flatnonzero(counts)
        counts = counts[present]
        return Grouped(np.argsort(cell, kind="stable"), present, np.cumsum(counts) - counts, counts)

    def add(self, grouped: Grouped, t: Floats, y: Floats, rows: Floats) -> None:
        """Add samples t, y (N,) in their cells' order; rows: room for five, and T₀ … of them, as many as are summed."""
        present, starts, counts = grouped.present, grouped.starts, grouped.counts
        for i in np.flatnonzero(self.sums[5, present] == 0):
            k, part = present[i], slice(starts[i], starts[i] + counts[i])
            self.lines[:, k] = first_line(t[part] - self.middles[k], y[part])
        value, slope = self.lines[:, present]
        o, square, z, product, rest = rows[:5]
        np.subtract(t, np.repeat(self.middles[present], counts), out=o)
        np.multiply(o, np.repeat(slope, counts), out=z)
        z += np.repeat(value, counts)
        np.subtract(y, z, out=z)
        np.multiply(o, o, out=square)
        np.multiply(o, z, out=product)
        np.multiply(z, z, out=rest)
        self.sums[:, present] += np.add.reduceat(rows, starts, axis=1)
        self.ends[0, present] = np.minimum(self.ends[0, present], np.minimum.reduceat(t, starts))
        self.ends[1, present] = np.maximum(self.ends[1, present], np.maximum.reduceat(t, starts))

    @property
    def terms(self) -> Floats:
        """Return Σ T₀ … of every cell; the first is how many samples it has."""
        return self.sums[5:]

    def between(self, low: float, high: float) -> NDArray[np.intp]:
        """Return the cells from one cut to below another."""
        return np.arange(np.searchsorted(self.cuts, low) + 1, np.searchsorted(self.cuts, high) + 1)

    def about(self, cells: NDArray[np.intp], centre: float, line: Floats) -> Floats:
        """Return Σ of (1, o, z), products of each two, (3, 3), of cells together: o from a centre, z from a line there."""
        total = np.zeros((3, 3))
        for k in cells:
            o, square, z, product, rest, count = self.sums[:6, k]
            own = np.array([[count, o, z], [o, square, product], [z, product, rest]])
            off = self.middles[k] - centre
            value, slope = self.lines[:, k] - (line[0] + line[1] * off, line[1])
            shift = np.array([[1.0, 0.0, 0.0], [off, 1.0, 0.0], [value, slope, 1.0]])
            total += shift @ own @ shift.T
        return total


def first_line(o: Floats, y: Floats) -> tuple[float, float]:
    """Return value and slope of the line through samples, of the constant where they are too few or at one input."""
    middle, mean = float(o.mean()), float(y.mean())
    away = o - middle
    square = float(away @ away)
    slope = float(away @ y) / square if len(o) > 2 and square > 0 else 0.0
    return mean - slope * middle, slope
