"""A filter between two static curves: first curves for a known filter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.fit import linear_least_squares
from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages._cascade import Filter

HINGES = 8
ROUNDS = 6  # of the two curves in turn


class Between(NamedTuple):
    """A filter with straight-line curves in front of it and behind it."""

    way: str
    filter: Filter
    points: tuple[Floats, Floats]  # (K,) levels at either curve
    heights: tuple[Floats, Floats]  # (K,) the curves there
    rms: float


class TwoCurves(NamedTuple):
    """Starts of curve, filter, curve, the best first, each with the error that it leaves."""

    way: tuple[str, ...]
    rms: Annotated[Floats, Quantity("output", ("start",))]
    best: tuple[Between, ...]

    def table(self) -> Table:
        """Return one row a start."""
        rows = tuple((way, float(f"{rms:.4g}")) for way, rms in zip(self.way, self.rms, strict=True))
        return Table("Curve, filter, curve", ("start", "rms"), rows)


def two_curves(u: Floats, y: Floats, use: NDArray[np.bool_], filters: list[Filter]) -> TwoCurves:
    """Find curves f and g so that g(G·f(u)) is near y, for every filter G given.

    Three ways to begin: f from y ≈ G·f(u), linear in f's heights; g from y ≈ g(G·u); f from the largest canonical
    correlation of G·f(u) with a curve of y, which needs a g that can be inverted. Then f and g in turn: g by linear least
    squares, f by a Gauss-Newton step through g's slope, kept while the error falls. f leaves the spread of u as it is, and
    f(0) = 0. u, y (N,); use (N,) where y counts.
    Source of the third [Hotelling 1936], [Breiman and Friedman 1985, JASA 80].
    """
    found = [_alternated(u, y, use, h, way, f) for h in filters for way, f in _first(u, y, use, h)]
    found.sort(key=lambda start: start.rms)
    return TwoCurves(tuple(s.way for s in found), np.array([s.rms for s in found]), tuple(found))


def _first(u: Floats, y: Floats, use: NDArray[np.bool_], h: Filter) -> Iterator[tuple[str, Floats]]:
    """Yield a first f, as heights at evenly spaced levels."""
    points = _levels(u)
    through = h.through(_hats(u, points)).T[use]
    yield "hammerstein first", linear_least_squares(through, y[use]).values
    yield "wiener first", points
    of_y = _hats(y[use], _levels(y[use])).T
    (q, r), (q_y, _) = (np.linalg.qr(x - x.mean(axis=0)) for x in (through[:, 1:], of_y[:, 1:]))
    left, _, _ = np.linalg.svd(q.T @ q_y)
    with np.errstate(all="ignore"):
        heights = np.linalg.lstsq(r, left[:, 0], rcond=1e-10)[0]
    yield "correlation", np.append(0.0, heights)


def _alternated(u: Floats, y: Floats, use: NDArray[np.bool_], h: Filter, way: str, f: Floats) -> Between:
    points = _levels(u)
    basis = _hats(u, points)
    through = h.through(basis)
    best = _behind(f, points, basis, through, y, use)
    for _ in range(ROUNDS):
        heights, (levels, g), _ = best
        x = (heights @ through)[use]
        slope = np.diff(g)[np.searchsorted(levels[1:-1], x, side="right")] / (levels[1] - levels[0])
        left = y[use] - np.interp(x, levels, g)
        step = linear_least_squares(through.T[use] * slope[:, None], left).values
        trial = min(
            (_behind(heights + share * step, points, basis, through, y, use) for share in (1.0, 0.5, 0.2)),
            key=lambda t: t[2],
        )
        if trial[2] > 0.999 * best[2]:
            break
        best = trial
    heights, (levels, g), rms = best
    return Between(way, h, (points, levels), (heights, g), rms)


def _behind(
    f: Floats, points: Floats, basis: Floats, through: Floats, y: Floats, use: NDArray[np.bool_]
) -> tuple[Floats, tuple[Floats, Floats], float]:
    """Return f scaled, the levels and heights of the g that suits it, and the error."""
    w, u = f @ basis, points @ basis
    rest = float(np.interp(0.0, points, f))
    f = (f - rest) * float(u.std()) / (float(w.std()) or 1.0)
    x = f @ through
    levels = _levels(x)
    design = _hats(x[use], levels).T
    g = linear_least_squares(design, y[use])
    return f, (levels, g.values), float(np.sqrt(g.chi2 / use.sum()))


def _levels(x: Floats) -> Floats:
    return np.linspace(x.min(), x.max(), HINGES + 2)


def _hats(x: Floats, points: Floats) -> Floats:
    """Return the hat function of every point at x: (K, N)."""
    k = np.clip(np.searchsorted(points, x, side="right") - 1, 0, len(points) - 2)
    share = (x - points[k]) / (points[k + 1] - points[k])
    rows = np.zeros((len(points), len(x)))
    every = np.arange(len(x))
    rows[k, every], rows[k + 1, every] = 1 - share, share
    return rows
