"""Polynomial pieces joined: a jump or a kink at every border, then one fit of all coefficients and kinks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from whid.fit import NEAR, Estimate, Parameter, least_squares, linear_least_squares
from whid.signal import Floats


@dataclass(frozen=True, eq=False)
class Layout:
    """A way to cut M levels: `cuts[k]` is the first level right of border k; `knots[k]` is NaN at a jump."""

    z: Floats  # (M,) levels scaled to [−1, 1]
    mean: Floats
    weight: Floats
    cuts: NDArray[np.intp]  # (S,)
    degrees: NDArray[np.intp]  # (S + 1,)
    knots: Floats  # (S,)

    @cached_property
    def jump(self) -> NDArray[np.bool_]:
        """Return which borders are jumps."""
        return np.isnan(self.knots)

    @cached_property
    def offsets(self) -> NDArray[np.intp]:
        """Return where each piece's coefficients start in the long vector, and its length."""
        return np.append(0, np.cumsum(self.degrees + 1))

    def pair(self, k: int) -> Layout:
        """Return border k with the two pieces beside it, a jump."""
        start, cut, stop = np.concatenate([[0], self.cuts, [len(self.z)]])[k : k + 3]
        part = slice(start, stop)
        jump = np.array([np.nan])
        return Layout(
            self.z[part], self.mean[part], self.weight[part], np.array([cut - start]), self.degrees[k : k + 2], jump
        )  # fmt: skip

    def design(self, knots: Floats) -> Floats:
        """Return (M, coefficients): each level in the piece it lies in, a kink moving levels across as it moves."""
        ends = np.where(self.jump, (self.z[self.cuts - 1] + self.z[self.cuts]) / 2, knots)
        under = np.searchsorted(ends, self.z, side="right")
        return np.where(under[:, None] == self.places[0], self._rows, 0.0)

    @cached_property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return piece and power of every coefficient in the long vector."""
        piece = np.repeat(np.arange(len(self.degrees)), self.degrees + 1)
        return piece, np.arange(len(piece)) - self.offsets[piece]

    @cached_property
    def _rows(self) -> Floats:
        return np.asarray(self.z[:, None] ** self.places[1])


def meet(layout: Layout, price: float) -> Layout:
    """Decide every border: a kink where making its pieces meet, at the point where that costs least, costs χ² ≤ price."""
    return replace(layout, knots=np.array([_meeting(layout.pair(k), price) for k in range(len(layout.cuts))]))


def _meeting(pair: Layout, price: float) -> float:
    """Return where two pieces meet, NaN where they do not.

    Pieces fitted apart that cross inside their gap meet for nothing. Those that cross beyond it have levels to hand
    over: one fit with the knot free tells the price. Those that do not cross at all differ by D(z) = right − left, and
    making them meet at z costs D²/var(D) exactly.
    """
    free = linear_least_squares(pair.design(pair.knots), pair.mean, pair.weight)
    low, high = _reach(pair)
    left, right = (int(degree) + 1 for degree in pair.degrees)
    gap = pair.z[pair.cuts[0] - 1 : pair.cuts[0] + 1]
    roots = poly.polyroots(poly.polysub(free.values[left:], free.values[:left]))
    roots = roots[np.abs(roots.imag) < 1e-9].real
    roots = roots[(roots >= low) & (roots <= high)]
    if len(roots):
        nearest = float(roots[np.argmin(np.abs(roots - gap.mean()))])
        if gap[0] <= nearest <= gap[1]:
            return nearest
        fit, met = joint(replace(pair, knots=np.array([nearest])), 10)
        return float(met.knots[0]) if fit.chi2 - free.chi2 <= price else float("nan")
    where = np.linspace(gap[0], gap[1], 65)
    rows = difference(where, left, right)
    cost = (rows @ free.values) ** 2 / np.einsum("ij,jk,ik->i", rows, free.covariance, rows)
    return float(where[np.argmin(cost)]) if cost.min() <= price else float("nan")


def hidden_jump(layout: Layout, k: int) -> float:
    """Return the largest jump anywhere in the gap of border k that the levels allow (95 %), its pieces fitted apart."""
    pair = layout.pair(k)
    free = linear_least_squares(pair.design(pair.knots), pair.mean, pair.weight)
    where = np.linspace(pair.z[pair.cuts[0] - 1], pair.z[pair.cuts[0]], 65)
    rows = difference(where, int(pair.degrees[0]) + 1, int(pair.degrees[1]) + 1)
    std = np.sqrt(np.einsum("ij,jk,ik->i", rows, free.covariance, rows))
    return float(np.max(np.abs(rows @ free.values) + 1.96 * std))


def difference(z: Floats, left: int, right: int) -> Floats:
    """Return rows that give right − left at z from the coefficients of two neighbouring pieces."""
    return np.hstack([-_powers(z, left - 1), _powers(z, right - 1)])


def _powers(z: Floats, degree: int) -> Floats:
    return np.asarray(z[:, None] ** np.arange(degree + 1))


def joint(layout: Layout, iterations: int = 100) -> tuple[Estimate, Layout]:
    """Fit all coefficients and kinks at once; a kink's right piece has no constant of its own."""
    kinks = np.flatnonzero(~layout.jump)
    free = np.delete(np.arange(layout.offsets[-1]), layout.offsets[kinks + 1])
    start = linear_least_squares(layout.design(layout.knots), layout.mean, layout.weight)
    low, high = _reach(layout)
    parameters = [Parameter(str(k), float(start.values[k])) for k in free]
    parameters += [Parameter(f"knot.{k}", float(layout.knots[k]), "1", float(low[k]), float(high[k])) for k in kinks]

    known: dict[bytes, tuple[Floats, Floats]] = {}

    def unpacked(theta: Floats) -> Floats:
        knots = layout.knots.copy()
        knots[kinks] = theta[len(free) :]
        return knots

    def linearised(theta: Floats) -> tuple[Floats, Floats]:
        key = theta.tobytes()
        if key not in known:
            known.clear()
            knots = unpacked(theta)
            coefficients, change = _continued(layout, free, theta[: len(free)], knots)
            design = layout.design(knots)
            known[key] = design @ coefficients - layout.mean, design @ change
        return known[key]

    found = least_squares(
        lambda theta: linearised(theta)[0], lambda theta: linearised(theta)[1], parameters, layout.weight,
        max_iterations=iterations, damping=NEAR,
    )  # fmt: skip
    knots = unpacked(found.values)
    cuts = layout.cuts.copy()
    cuts[kinks] = np.searchsorted(layout.z, knots[kinks], side="right").clip(1, len(layout.z) - 1)
    coefficients, change = _continued(layout, free, found.values[: len(free)], knots)
    covariance = change @ found.covariance @ change.T
    done = replace(layout, cuts=cuts, knots=knots)
    return found._replace(
        values=np.append(knots, coefficients), covariance=_with_breaks(done, found, change, covariance)
    ), done


def _reach(layout: Layout) -> tuple[Floats, Floats]:
    """Return how far each kink may move: as far as the pieces beside it keep the levels that their degree needs."""
    spare = (np.diff(np.concatenate([[0], layout.cuts, [len(layout.z)]])) - layout.degrees - 1) // 2
    return layout.z[layout.cuts - 1 - spare[:-1]], layout.z[layout.cuts + spare[1:]]


def _continued(layout: Layout, free: NDArray[np.intp], values: Floats, knots: Floats) -> tuple[Floats, Floats]:
    """Return all coefficients (C,) and their derivative (C, free + kinks): a kink's constant makes its pieces meet."""
    kinks = np.flatnonzero(~layout.jump)
    coefficients = np.zeros(layout.offsets[-1])
    coefficients[free] = values
    change = np.zeros((len(coefficients), len(free) + len(kinks)))
    change[free, np.arange(len(free))] = 1.0
    for column, k in enumerate(kinks, len(free)):
        left, middle, right = layout.offsets[k : k + 3]
        piece, power = (each[left:right] for each in layout.places)
        sign = np.where(piece == k, 1.0, -1.0)
        row = sign * knots[k] ** power
        coefficients[middle] = row @ coefficients[left:right]
        change[middle] = row @ change[left:right]
        change[middle, column] += (sign * power * knots[k] ** np.maximum(power - 1, 0)) @ coefficients[left:right]
    return coefficients, change


def _with_breaks(layout: Layout, found: Estimate, change: Floats, coefficients: Floats) -> Floats:
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


def rescaled(layout: Layout, estimate: Estimate, middle: float, half: float) -> tuple[tuple[str, ...], Floats, Floats]:
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


@lru_cache
def _expansion(size: int, shift: float, slope: float) -> Floats:
    """Return the matrix that turns coefficients in shift + slope·u into coefficients in u."""
    columns = [poly.polypow([shift, slope], power) for power in range(size)]
    return np.column_stack([np.pad(column, (0, size - len(column))) for column in columns])
