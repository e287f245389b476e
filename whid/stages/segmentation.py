"""Static curve cut into polynomial pieces: how many, of what degree, and what happens at each border."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.fit import Estimate, Parameter, least_squares, linear_least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._visits import pooled, visit_variance
from whid.stages.levels import StaticCurve


class Segmentation(NamedTuple):
    """Segmentation: a polynomial on each interval, ascending powers of the input."""

    borders: Annotated[Floats, Quantity("input", ("break", "side"))]  # (S, 2) last level left, first level right
    breaks: Annotated[Floats, Quantity("input", ("break",), error="break_std")]
    break_std: Annotated[Floats, Quantity("input", ("break",))]
    jump: Annotated[NDArray[np.bool_], Quantity("1", ("break",))]  # False: a kink, the pieces meet
    jump_size: Annotated[Floats, Quantity("output", ("break",), error="jump_size_std")]  # right minus left, at the break
    jump_size_std: Annotated[Floats, Quantity("output", ("break",))]
    degrees: Annotated[NDArray[np.intp], Quantity("1", ("piece",))]
    coefficients: Annotated[Floats, Quantity("output", ("piece", "power"), error="coefficients_std")]  # NaN beyond the degree
    coefficients_std: Annotated[Floats, Quantity("output", ("piece", "power"))]
    estimate: Estimate  # of every break and coefficient, `breaks.0`, `pieces.0.1`; a kink makes it singular
    chi2: float
    dof: int
    p: float
    visit_std: Annotated[float, Quantity("output")]  # scatter of repeated visits beyond noise, part of every error

    def table(self) -> Table:
        """Return one row a piece, with the break that ends it."""
        rows = []
        for k, degree in enumerate(self.degrees):
            terms = [Measured(float(c), float(s)) for c, s in zip(self.coefficients[k], self.coefficients_std[k], strict=True)]
            cells = [*terms[: degree + 1], *[None] * (len(terms) - degree - 1)]
            end = ("", None) if k == len(self.breaks) else (
                "jump" if self.jump[k] else "kink", Measured(float(self.breaks[k]), float(self.break_std[k]))
            )  # fmt: skip
            rows.append((*cells, *end))
        powers = tuple(f"u^{k}" if k > 1 else ("1", "u")[k] for k in range(self.coefficients.shape[1]))
        notes = [f"χ²({self.dof}) = {self.chi2:.3g}, p = {self.p:.2g}"]
        notes += [f"repeated visits scatter by {self.visit_std:.3g} beyond noise"] if self.visit_std else []
        notes += ["a jump's break is only known to lie in its gap"] if self.jump.any() else []
        notes += ["a kink is the simplest reading: a jump inside its gap fits the levels as well"] if not self.jump.all() else []
        return Table("pieces of the static curve", (*powers, "ends in", "at"), tuple(rows), tuple(notes))


def segment(curve: StaticCurve, max_degree: int = 3, price: float = 10.8) -> Segmentation:
    """Cut a static curve into the fewest polynomial pieces that its errors allow.

    Intervals: least Σ over pieces of χ² + price·(degree + 2), by dynamic programming over all intervals of levels; degree ≤
    max_degree and < the number of levels. Border: a kink when making the pieces meet inside the gap costs χ² ≤
    price (the best meeting point is found continuously), else a jump, whose break is only known to lie in its gap (middle,
    std gap/√12). Then one joint fit of all coefficients and kinks. Visits of one level are averaged; where they scatter beyond
    noise that scatter is part of every error. Raises `WhidError("stage-too-short")` below two levels.
    Source [PAPERS A, build 3]; [Brouri2019], Remark 3.2.

    >>> from whid.stages.levels import level_means
    >>> u = np.arange(-4.0, 5.0)
    >>> rng = np.random.default_rng(3)
    >>> holds = [np.maximum(v - 0.5, 0) + 0.1 * rng.normal(size=400) for v in u]
    >>> found = segment(level_means(holds, u, np.ones(9), 1.0, 0.0))
    >>> found.degrees, found.jump, found.breaks.round(1)
    (array([0, 1]), array([False]), array([0.5]))
    """
    from scipy.special import chdtrc

    extra = visit_variance(curve)
    level, mean, std, _, _ = pooled(curve, extra=extra)
    if len(level) < 2:
        raise WhidError("stage-too-short", "a static curve needs two levels or more")
    middle, half = (level[0] + level[-1]) / 2, (level[-1] - level[0]) / 2
    z = (level - middle) / half
    cuts, degrees = _intervals(z, mean, std, max_degree, price)
    layout = _meet(_Layout(z, mean, 1 / std, cuts, degrees, np.full(len(cuts), np.nan)), price)
    estimate, layout = _joint(layout)
    names, values, covariance = _rescaled(layout, estimate, middle, half)
    count = len(layout.cuts)
    full = estimate._replace(
        names=names, values=values, covariance=covariance, std=np.sqrt(np.diag(covariance)), null_directions=np.empty((0, len(names)))
    )
    coefficients, errors = _padded(values[count:], degrees), _padded(full.std[count:], degrees)
    size, size_std = _jump_sizes(values[:count], values[count:], covariance[count:, count:], degrees)
    p = float(chdtrc(estimate.dof, estimate.chi2)) if estimate.dof > 0 else 1.0
    return Segmentation(
        np.column_stack([level[layout.cuts - 1], level[layout.cuts]]), values[:count], full.std[:count], layout.jump,
        size, size_std, degrees, coefficients, errors, full, estimate.chi2, estimate.dof, p, float(np.sqrt(extra)),
    )  # fmt: skip


class _Layout(NamedTuple):
    """A way to cut M levels: `cuts[k]` is the first level right of border k; `knots[k]` is NaN at a jump."""

    z: Floats  # (M,) levels scaled to [−1, 1]
    mean: Floats
    weight: Floats
    cuts: NDArray[np.intp]  # (S,)
    degrees: NDArray[np.intp]  # (S + 1,)
    knots: Floats  # (S,)

    @property
    def jump(self) -> NDArray[np.bool_]:
        return np.isnan(self.knots)

    @property
    def offsets(self) -> NDArray[np.intp]:
        """Return where each piece's coefficients start in the long vector, and its length."""
        return np.append(0, np.cumsum(self.degrees + 1))

    def design(self, knots: Floats) -> Floats:
        """Return (M, coefficients): each level in the piece it lies in, a kink moving levels across as it moves."""
        ends = np.where(self.jump, (self.z[self.cuts - 1] + self.z[self.cuts]) / 2, knots)
        piece = np.searchsorted(ends, self.z, side="right")
        matrix = np.zeros((len(self.z), self.offsets[-1]))
        for k, degree in enumerate(self.degrees):
            inside = piece == k
            matrix[inside, self.offsets[k] : self.offsets[k + 1]] = poly.polyvander(self.z[inside], degree)
        return matrix


def _intervals(
    z: Floats, mean: Floats, std: Floats, max_degree: int, price: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the cheapest cuts and degrees by dynamic programming."""
    count = len(z)
    cost, degree = _interval_costs(z, mean, std, max_degree, price)
    best, come = np.append(0.0, np.full(count, np.inf)), np.zeros(count + 1, np.intp)
    for stop in range(1, count + 1):
        total = best[:stop] + cost[:stop, stop]
        come[stop] = np.argmin(total)
        best[stop] = total[come[stop]]
    cuts = [count]
    while cuts[0]:
        cuts.insert(0, int(come[cuts[0]]))
    return np.array(cuts[1:-1], np.intp), np.array([degree[a, b] for a, b in pairwise(cuts)], np.intp)


def _interval_costs(
    z: Floats, mean: Floats, std: Floats, max_degree: int, price: float
) -> tuple[Floats, NDArray[np.intp]]:
    """Return the cheapest χ² + price·(degree + 2) of the levels start … stop − 1, and its degree, as [start, stop].

    All intervals of one length are projected at once on orthonormal polynomials; this only ranks, `_joint` fits.
    """
    count = len(z)
    cost, chosen = np.full((count, count + 1), np.inf), np.zeros((count, count + 1), np.intp)
    for size in range(1, count + 1):
        rows = np.arange(count - size + 1)[:, None] + np.arange(size)
        degree = min(max_degree, size - 1)
        local = z[rows] - z[rows].mean(axis=1, keepdims=True)
        local /= np.maximum(np.abs(local).max(axis=1, keepdims=True), 1e-300)
        weight = 1 / std[rows]
        basis = np.linalg.qr(legendre.legvander(local, degree) * weight[:, :, None])[0]
        left = (mean[rows] - mean[rows].mean(axis=1, keepdims=True)) * weight
        totals = np.empty((degree + 1, len(rows)))
        for d in range(degree + 1):  # subtract one direction at a time: no cancellation of large sums
            left = left - basis[:, :, d] * np.einsum("ij,ij->i", basis[:, :, d], left)[:, None]
            totals[d] = np.einsum("ij,ij->i", left, left) + price * (d + 2)
        start = rows[:, 0]
        chosen[start, start + size] = totals.argmin(axis=0)
        cost[start, start + size] = totals.min(axis=0)
    return cost, chosen


def _meet(layout: _Layout, price: float) -> _Layout:
    """Decide every border: a kink, at the point where making its pieces meet costs least, if that is ≤ price.

    The pieces fitted apart differ at z by D(z) = right − left; making them meet there costs D²/var(D) exactly.
    """
    free = linear_least_squares(layout.design(layout.knots), layout.mean, layout.weight)
    knots = layout.knots.copy()
    for k, cut in enumerate(layout.cuts):
        left, middle, right = layout.offsets[k : k + 3]
        part = slice(left, right)
        where = np.linspace(layout.z[cut - 1], layout.z[cut], 65)

        def cost(point: Floats, split: int = middle - left, part: slice = part) -> Floats:
            rows = _difference(point, split, part.stop - part.start - split)
            return np.asarray((rows @ free.values[part]) ** 2 / np.einsum("ij,jk,ik->i", rows, free.covariance[part, part], rows))

        for _ in range(8):  # each pass narrows the bracket 32 times, past rounding
            least = int(np.argmin(cost(where)))
            where = np.linspace(where[max(least - 1, 0)], where[min(least + 1, 64)], 65)
        if cost(where).min() <= price:
            knots[k] = where[np.argmin(cost(where))]
    return layout._replace(knots=knots)


def _difference(z: Floats, left: int, right: int) -> Floats:
    """Return rows that give right − left at z from the coefficients of two neighbouring pieces."""
    return np.hstack([-poly.polyvander(z, left - 1), poly.polyvander(z, right - 1)])


def _joint(layout: _Layout) -> tuple[Estimate, _Layout]:
    """Fit all coefficients and kinks at once; a kink's right piece has no constant of its own."""
    kinks = np.flatnonzero(~layout.jump)
    free = np.setdiff1d(np.arange(layout.offsets[-1]), layout.offsets[kinks + 1])
    start = linear_least_squares(layout.design(layout.knots), layout.mean, layout.weight)
    low, high = _reach(layout)
    parameters = [Parameter(str(k), float(start.values[k])) for k in free]
    parameters += [Parameter(f"knot.{k}", float(layout.knots[k]), "1", float(low[k]), float(high[k])) for k in kinks]

    def unpack(theta: Floats) -> tuple[Floats, Floats]:
        knots = layout.knots.copy()
        knots[kinks] = theta[len(free) :]
        return _continued(layout, free, theta[: len(free)], knots)[0], knots

    def residual(theta: Floats) -> Floats:
        coefficients, knots = unpack(theta)
        return np.asarray(layout.design(knots) @ coefficients - layout.mean)

    def tangent(theta: Floats) -> Floats:
        _, knots = unpack(theta)
        return np.asarray(layout.design(knots) @ _continued(layout, free, theta[: len(free)], knots)[1])

    found = least_squares(residual, tangent, parameters, layout.weight)
    _, knots = unpack(found.values)
    cuts = layout.cuts.copy()
    cuts[kinks] = np.searchsorted(layout.z, knots[kinks], side="right").clip(1, len(layout.z) - 1)
    coefficients, change = _continued(layout, free, found.values[: len(free)], knots)
    covariance = change @ found.covariance @ change.T
    done = layout._replace(cuts=cuts, knots=knots)
    return found._replace(values=np.append(knots, coefficients), covariance=_with_breaks(done, found, change, covariance)), done


def _reach(layout: _Layout) -> tuple[Floats, Floats]:
    """Return how far each kink may move: its gap, and one level on where the piece can spare it."""
    edges = np.concatenate([[0], layout.cuts, [len(layout.z)]])
    spare = np.diff(edges) > layout.degrees + 1
    low = [layout.z[max(c - 1 - s, 0)] for c, s in zip(layout.cuts, spare[:-1], strict=True)]
    high = [layout.z[min(c + s, len(layout.z) - 1)] for c, s in zip(layout.cuts, spare[1:], strict=True)]
    return np.array(low), np.array(high)


def _continued(layout: _Layout, free: NDArray[np.intp], values: Floats, knots: Floats) -> tuple[Floats, Floats]:
    """Return all coefficients (C,) and their derivative (C, free + kinks): a kink's constant makes its pieces meet."""
    kinks = np.flatnonzero(~layout.jump)
    coefficients = np.zeros(layout.offsets[-1])
    coefficients[free] = values
    change = np.zeros((len(coefficients), len(free) + len(kinks)))
    change[free, np.arange(len(free))] = 1.0
    for column, k in enumerate(kinks, len(free)):
        left, middle, right = layout.offsets[k : k + 3]
        row = -_difference(knots[k : k + 1], middle - left, right - middle)[0]
        coefficients[middle] = row @ coefficients[left:right]
        change[middle] = row @ change[left:right]
        slopes = [poly.polyval(knots[k], poly.polyder(coefficients[a:b])) for a, b in ((left, middle), (middle, right))]
        change[middle, column] += slopes[0] - slopes[1]
    return coefficients, change


def _with_breaks(layout: _Layout, found: Estimate, change: Floats, coefficients: Floats) -> Floats:
    """Return the covariance of (breaks, coefficients); a jump's break is uniform in its gap, independent of the rest."""
    kinks, count = np.flatnonzero(~layout.jump), len(layout.cuts)
    covariance = np.zeros((count + len(coefficients),) * 2)
    covariance[count:, count:] = coefficients
    moved = found.covariance[-len(kinks) :] if len(kinks) else np.empty((0, found.covariance.shape[0]))
    covariance[np.ix_(kinks, kinks)] = moved[:, moved.shape[1] - len(kinks) :]
    covariance[kinks, count:] = moved @ change.T
    covariance[count:, kinks] = (moved @ change.T).T
    jumps = np.flatnonzero(layout.jump)
    covariance[jumps, jumps] = (layout.z[layout.cuts[jumps]] - layout.z[layout.cuts[jumps] - 1]) ** 2 / 12
    return covariance


def _rescaled(layout: _Layout, estimate: Estimate, middle: float, half: float) -> tuple[tuple[str, ...], Floats, Floats]:
    """Return names, values and covariance of breaks and coefficients in the input's own unit."""
    count = len(layout.cuts)
    centres = (layout.z[layout.cuts - 1] + layout.z[layout.cuts]) / 2
    knots = np.where(layout.jump, centres, layout.knots)
    change = np.zeros((len(estimate.values),) * 2)
    change[:count, :count] = half * np.eye(count)
    for a, b in pairwise(count + layout.offsets):
        change[a:b, a:b] = _expansion(b - a, -middle / half, 1 / half)
    values = change @ np.append(knots, estimate.values[count:])
    values[:count] += middle
    names = [f"breaks.{k}" for k in range(count)]
    names += [f"pieces.{k}.{power}" for k, degree in enumerate(layout.degrees) for power in range(degree + 1)]
    return tuple(names), values, change @ estimate.covariance @ change.T


def _expansion(size: int, shift: float, slope: float) -> Floats:
    """Return the matrix that turns coefficients in shift + slope·u into coefficients in u."""
    columns = [poly.polypow([shift, slope], power) for power in range(size)]
    return np.column_stack([np.pad(column, (0, size - len(column))) for column in columns])


def _padded(flat: Floats, degrees: Sequence[int] | NDArray[np.intp]) -> Floats:
    rows = np.full((len(degrees), int(max(degrees)) + 1), np.nan)
    for row, part in zip(rows, np.split(flat, np.cumsum(np.asarray(degrees)[:-1] + 1)), strict=True):
        row[: len(part)] = part
    return rows


def _jump_sizes(breaks: Floats, flat: Floats, covariance: Floats, degrees: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Return right − left at every break and its error, the break taken as it stands."""
    offsets = np.append(0, np.cumsum(degrees + 1))
    size, std = np.zeros(len(breaks)), np.zeros(len(breaks))
    for k, b in enumerate(breaks):
        left, middle, right = offsets[k : k + 3]
        row = _difference(np.array([b]), middle - left, right - middle)[0]
        size[k] = row @ flat[left:right]
        std[k] = np.sqrt(max(row @ covariance[left:right, left:right] @ row, 0.0))
    return size, std
