"""The line of inputs cut into cells, and sums over the samples in every cell: a window is some cells next to each other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats
from whid.stages._chebyshev import Moments, empty

FINE = 1 << 16  # steps of the table that tells an input's cell: it stays in the cache
FINER = 14  # cells an order
OFFSETS, PRODUCTS = 6, 6  # powers of o, and of o beside z: to 1e-11 of Σ T_m, to 1e-10 of Σ r·T_m
ROOM = 3  # rows that a chunk needs


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

    Across a cell T_m is hardly more than a short power series: Σ oʲ and Σ z·oʲ of every cell, o from its middle, tell Σ T_m
    and Σ y·T_m to some 1e-10. They cost half of what the terms themselves do, and a window is some cells as well. z = y less
    the tangent of a pilot curve there: small, so that nothing cancels.

    cuts   places that have to be cuts, −1 and 1 among them; more are put between, as close as order M asks for
    pilot  Chebyshev coefficients of a curve near y

    >>> Cells(np.array([-1.0, 0.0, 1.0]), 1, np.zeros(2)).group(np.array([0.5, -0.5, -1.0, 2.0, 1.0])).order
    array([2, 1, 0, 3, 4])
    """

    def __init__(self, cuts: Floats, order: int, pilot: Floats) -> None:
        between = np.cos(np.linspace(0, np.pi, FINER * order + 1)[1:-1])
        self.cuts = np.unique(np.concatenate([cuts[np.isfinite(cuts)], between]))
        self.middles = np.concatenate([self.cuts[:1], (self.cuts[1:] + self.cuts[:-1]) / 2, self.cuts[-1:]])
        n = len(self.middles)
        self.sums = np.zeros((2 + OFFSETS + PRODUCTS, n))  # Σ 1, o … o⁶; z … z·o⁵; z²
        self.ends = np.tile([[np.inf], [-np.inf]], (1, n))
        self.course = np.einsum("k,kjn->jn", pilot, np.array(list(self.series(len(pilot) - 1))))  # of the pilot
        self._tabulate()

    def series(self, order: int) -> Iterator[Floats]:
        """Yield T₀ … T_M as powers of o about every middle, (7, C + 1): the recursion (4)-(6)."""
        last, now = np.zeros((2, OFFSETS + 1, len(self.middles)))
        now[0] = 1.0
        for m in range(order + 1):
            yield now
            following = (2 if m else 1) * self.middles * now - last
            following[1:] += (2 if m else 1) * now[:-1]
            last, now = now, following

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

    def add(self, grouped: Grouped, t: Floats, y: Floats, rows: Floats) -> tuple[float, float]:
        """Add samples t, y (N,); rows (3, N): room. Return the smallest and the largest t."""
        present, starts, counts = grouped.present, grouped.starts, grouped.counts
        value, slope = self.course[:2, present]
        o, z, power = rows
        np.take(t, grouped.order, out=o, mode="clip")
        low, high = np.minimum.reduceat(o, starts), np.maximum.reduceat(o, starts)
        o -= np.repeat(self.middles[present], counts)
        np.take(y, grouped.order, out=z, mode="clip")
        np.multiply(o, np.repeat(slope, counts), out=power)
        z -= power
        z -= np.repeat(value, counts)
        found = [counts]
        for first, powers in ((o, OFFSETS), (z, PRODUCTS)):
            found.append(np.add.reduceat(first, starts))
            for j in range(1, powers):
                np.multiply(power if j > 1 else first, o, out=power)
                found.append(np.add.reduceat(power, starts))
        np.multiply(z, z, out=power)
        self.sums[:, present] += np.array([*found, np.add.reduceat(power, starts)])
        self.ends[0, present] = np.minimum(self.ends[0, present], low)
        self.ends[1, present] = np.maximum(self.ends[1, present], high)
        return float(low[0]), float(high[-1])

    def terms(self, order: int) -> Floats:
        """Return Σ T₀ … T_M of every cell, (M + 1, C + 1)."""
        return np.array([np.einsum("jn,jn->n", each, self.sums[: OFFSETS + 1]) for each in self.series(order)])

    def moments(self, cells: NDArray[np.intp], order: int) -> Moments:
        """Return the moments, up to an order, of what the pilot leaves over in cells together: r = z − bend."""
        offsets, products = self.sums[: OFFSETS + 1, cells], self.sums[OFFSETS + 1 : -1, cells]
        bend = np.array(self.course[:, cells])
        bend[:2] = 0.0  # the tangent
        found = empty(order)
        for m, each in enumerate(self.series(2 * order)):
            term = each[:, cells]
            found.sums[m] = np.vdot(term, offsets)
            if m <= order:
                found.products[m] = np.vdot(term[:PRODUCTS], products) - np.vdot(_times(bend, term), offsets)
        square = self.sums[-1, cells].sum() - 2 * np.vdot(bend[:PRODUCTS], products) + np.vdot(_times(bend, bend), offsets)
        return found._replace(square=max(0.0, float(square)), samples=round(offsets[0].sum()))

    def between(self, low: float, high: float) -> NDArray[np.intp]:
        """Return the cells from one cut to below another."""
        return np.arange(np.searchsorted(self.cuts, low) + 1, np.searchsorted(self.cuts, high) + 1)

    def line(self, cell: int, centre: float) -> tuple[float, float]:
        """Return the tangent of a cell, value at a centre and slope."""
        value, slope = self.course[:2, cell]
        return float(value + slope * (centre - self.middles[cell])), float(slope)

    def about(self, cells: NDArray[np.intp], centre: float, line: Floats) -> Floats:
        """Return Σ of (1, o, z), products of each two, (3, 3), of cells together: o from a centre, z from a line there."""
        count, o, square = self.sums[:3, cells]
        z, product, rest = self.sums[OFFSETS + 1, cells], self.sums[OFFSETS + 2, cells], self.sums[-1, cells]
        own = np.array([[count, o, z], [o, square, product], [z, product, rest]])
        off, shift = self.middles[cells] - centre, np.zeros((3, 3, len(cells)))
        shift[[0, 1, 2], [0, 1, 2]] = 1.0
        shift[1, 0] = off
        shift[2, 0], shift[2, 1] = self.course[0, cells] - line[0] - line[1] * off, self.course[1, cells] - line[1]
        return np.asarray(np.einsum("abn,bcn,dcn->ad", shift, own, shift))


def _times(a: Floats, b: Floats) -> Floats:
    """Return the product of two power series, (J, n), no longer than they are."""
    product = np.zeros_like(a)
    for j, row in enumerate(a):
        product[j:] += row * b[: len(b) - j]
    return product


def first_line(o: Floats, y: Floats) -> tuple[float, float]:
    """Return value and slope of the line through samples, of the constant where they are too few or at one input."""
    middle, mean = float(o.mean()), float(y.mean())
    away = o - middle
    square = float(away @ away)
    slope = float(away @ y) / square if len(o) > 2 and square > 0 else 0.0
    return mean - slope * middle, slope
