"""Forms of a static curve: how each is first drawn through points, and put on other knots.

spline: smooth, knots held (`spline`). hinges: straight lines between free knots (`table`), corners sharp or rounded.
piecewise: a polynomial with free kinks (`kinked`). saturation, dead_zone: that block, then a straight line (`polynomial`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Literal

import numpy as np

from whid.blocks._static import Static
from whid.blocks.dead_zone import DeadZone
from whid.blocks.kinked import Kinked, truncated
from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.blocks.spline import Spline
from whid.blocks.table import Table
from whid.fit import linear_least_squares
from whid.signal import Floats

Kind = Literal["spline", "hinges", "piecewise", "saturation", "dead_zone"]
SEEN = 50  # samples of which one knot is made,
SPARE = 4  # or of a short record one in so many of those that there are for each
BINS, ROUNDS = 20, 3
EVEN = 0.5  # knots spread evenly, over those placed by the bend
COUNTS: dict[Kind, tuple[int, ...]] = {  # knots tried in turn while they pay
    "spline": (8, 12, 20, 30),
    "hinges": (4, 6, 8, 12, 20),
    "piecewise": (1, 2, 3, 5, 8),
    "saturation": (0,),
    "dead_zone": (0,),
}
VISITS = 200  # levels that stand for all that arrive
CORNERS = 12  # levels at which corners are tried
SOFT = 0.1  # of the span: the first width of a knee


def drawn(
    kind: Kind, points: Floats, heights: Floats, v: Floats, *, degree: int = 2, soft: bool = False
) -> tuple[Static, ...]:
    """Return the curve of a kind through points, ascending; v the levels that arrive: where they are many it fits best."""
    if kind == "spline":
        return (Spline(inputs=tuple(map(float, points)), outputs=tuple(map(float, heights))),)
    if kind == "hinges":
        knee = SOFT * float(np.ptp(points)) / len(points) if soft else None
        return (Table(inputs=tuple(map(float, points)), outputs=tuple(map(float, heights)), knee=knee),)
    visited = np.quantile(v, np.linspace(0, 1, VISITS))
    curve = np.interp(visited, points, heights)
    if kind == "piecewise":
        return (_kinked(visited, curve, points[[0, -1]].mean(keepdims=True), degree),)
    return _cornered(Saturation if kind == "saturation" else DeadZone, visited, curve, soft)


def on(curve: Static, levels: Floats, knots: int, by_bend: bool) -> Static:
    """Return a curve on other knots over the levels that arrive, by where it bends or evenly; itself where it has none.

    Where it bends, but no more knots than one for fifty samples: a bend that a few samples made would draw ever more knots
    to itself, and at the end of the curve its slope would go on beyond it.
    """
    span = float(levels.min()), float(levels.max())
    if not isinstance(curve, (Spline, Table, Kinked)):
        return curve
    if isinstance(curve, Kinked):
        fine = np.linspace(*span, 400)
        return _kinked(fine, curve.value(fine), _placed(curve, levels, knots + 2, by_bend)[1:-1], len(curve.kinks[0]))
    inputs = _placed(curve, levels, knots, by_bend)
    points, heights = tuple(map(float, inputs)), tuple(map(float, curve.value(inputs)))
    if isinstance(curve, Spline):
        return Spline(inputs=points, outputs=heights)
    return Table(inputs=points, outputs=heights, knee=curve.knee)


def pinned(curve: Static) -> tuple[int, ...]:
    """Return the places, among a curve's parameters, of two whose hold fixes its scale and offset."""
    names = [p.name for p in curve.parameters()]
    if isinstance(curve, (Spline, Table)):
        heights, inner = np.array(curve.outputs), slice(1, -1) if len(curve.outputs) > 4 else slice(None)
        places = np.arange(len(heights))[inner]
        ends = places[[int(np.argmin(heights[inner])), int(np.argmax(heights[inner]))]]
        return tuple(names.index(f"outputs.{k}") for k in ends)
    head = "coefficients" if isinstance(curve, (Kinked, Polynomial)) else ""
    return tuple(k for k, name in enumerate(names) if name in (f"{head}.0", f"{head}.1"))


def loose(curve: Static) -> tuple[int, ...]:
    """Return the places, among a curve's parameters, of what changes nothing by itself: the outermost inputs of lines."""
    if not isinstance(curve, Table) or curve.beyond == "hold":
        return ()
    return (0, len(curve.inputs) - 1)


def raised(curve: Static, by: float) -> Static | None:
    """Return f + by, None where the curve has no room for it."""
    if isinstance(curve, (Spline, Table)):
        return replace(curve, outputs=tuple(w + by for w in curve.outputs))
    if isinstance(curve, (Kinked, Polynomial)):
        return replace(curve, coefficients=(curve.coefficients[0] + by, *curve.coefficients[1:]))
    return None


def shifted(curve: Static, by: float) -> Static | None:
    """Return f(v − by), None where that is no curve of the same kind with moved numbers."""
    if isinstance(curve, (Spline, Table)):
        return replace(curve, inputs=tuple(v + by for v in curve.inputs))
    return replace(curve, low=curve.low + by, high=curve.high + by) if isinstance(curve, DeadZone) else None


def _placed(curve: Static, levels: Floats, knots: int, by_bend: bool) -> Floats:
    fine = np.linspace(float(levels.min()), float(levels.max()), 1000)
    if not by_bend:
        return np.linspace(fine[0], fine[-1], knots)
    slope = np.gradient(curve.value(fine), fine)
    density = np.sqrt(np.abs(np.gradient(slope, fine)))
    density += EVEN * max(float(density.mean()), 1e-300)
    most = np.histogram(levels, BINS)[0] / min(SEEN, len(levels) / (SPARE * knots)) + 1e-9  # knots a bin
    binned = density.reshape(BINS, -1)
    for _ in range(ROUNDS):  # what is cut off goes elsewhere, and may be too much there
        there = binned.sum(axis=1) * knots / binned.sum()
        binned = binned * np.minimum(1.0, most / there)[:, None]
    share = np.cumsum(binned)
    share = (share - share[0]) / (share[-1] - share[0])
    return np.asarray(np.interp(np.linspace(0, 1, knots), share, fine))


def _kinked(v: Floats, w: Floats, breaks: Floats, degree: int) -> Kinked:
    powers = np.vander(v, degree + 1, increasing=True)
    design = np.column_stack([powers, *(truncated(v - b, m) for b in breaks for m in range(1, degree + 1))])
    found = linear_least_squares(design, w).values
    kinks = found[degree + 1 :].reshape(len(breaks), degree)
    return Kinked(
        coefficients=tuple(map(float, found[: degree + 1])),
        breaks=tuple(map(float, breaks)),
        kinks=tuple(tuple(map(float, row)) for row in kinks),
    )


def _cornered(kind: type[Saturation | DeadZone], v: Floats, w: Floats, soft: bool) -> tuple[Static, ...]:
    """Return a block with two corners and the straight line behind it: of all pairs of levels the one that fits best."""
    levels, knee = np.quantile(v, np.linspace(0, 1, CORNERS)), SOFT * float(np.ptp(v)) if soft else None
    best: tuple[float, tuple[Static, ...]] | None = None
    for low, high in combinations(np.unique(levels), 2):
        block = kind(low=float(low), high=float(high), knee=knee, fix=("slope",))
        line = linear_least_squares(np.column_stack([np.ones(len(v)), block.value(v)]), w)
        if best is None or line.chi2 < best[0]:
            best = line.chi2, (block, Polynomial(coefficients=(float(line.values[0]), float(line.values[1]))))
    assert best is not None
    return best[1]
