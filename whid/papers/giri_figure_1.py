"""[Giri], Figure 1: a backlash whose borders cross and are not invertible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import polynomial as poly

from whid.errors import WhidError
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._giri import LOST, arrow, borders
from whid.quantity import Measured
from whid.signal import Floats
from whid.stages._affine_fit import real_roots
from whid.stages._hysteresis import response
from whid.stages.joint_loops import paper_scale
from whid.stages.lissajous import carried

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AMPLITUDES = (0.4, 0.75, 1.0)  # of the loops drawn, over the largest that the sines reach
Sides = tuple[Floats, Floats]


@dataclass(frozen=True, kw_only=True)
class GiriFigure1(Exhibit):
    """Where the borders cross and turn, and the loops of three amplitudes between them ([Giri], Figure 1).

    efficient  the borders of one run of the study, all sines together
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return the borders' crossings and turning points within what the sines reach, G(0) = 1."""
        result = next(bench.results(1))
        if result.error:
            raise WhidError("table-failed", f"the run failed: {result.error.code}: {result.error.message}")
        found = result.stages["parametric_loops"]
        reach = float(max(np.abs(record.u).max() for record in result.records))
        true = borders(bench)
        n, covariance = len(found.rising), found.estimate.covariance[: 2 * len(found.rising), : 2 * len(found.rising)]
        rows = []
        for name, at in _marks(true, reach):
            value, spread = carried(partial(_at, at, n), np.append(found.rising, found.falling), covariance)
            for k, axis in enumerate(("x", "output")):
                cell = Measured(float(value[k]), float(np.sqrt(spread[k, k])))
                rows.append(Row(f"{axis} where {name}", None, None, cell, float(at(true)[k])))
        return Regenerated(
            "Figure 1 of Giri et al.: a backlash with borders that cross and are not invertible", rows,
            (LOST, "x is scaled so that G(0) = 1; the paper's own scale is that of eq. (29), "
             f"{1 / paper_scale(*true):.4g} times this one for these borders."),
            draw=lambda figure: _draw(figure, true, (found.rising, found.falling), reach),
            headings=("published", "paper's method, ours", "efficient, ours", "truth"),
        )  # fmt: skip


def _marks(true: Sides, reach: float) -> list[tuple[str, Callable[[Sides], Floats]]]:
    """Return name and place, as a function of the borders, of every crossing and turning point within reach."""
    found: list[tuple[str, Callable[[Sides], Floats]]] = []
    crossings = [float(x) for x in real_roots(poly.polysub(*true)) if abs(x) <= reach]
    found += [("the borders cross", partial(_root, which=None, near=x)) for x in crossings]
    for which, name in enumerate(("rising", "falling")):
        slope = poly.polyder(true[which])
        for x in real_roots(slope):
            if abs(x) <= reach:
                kind = "highest" if poly.polyval(x, poly.polyder(slope)) < 0 else "lowest"
                found.append((f"the {name} border is {kind}", partial(_root, which=which, near=float(x))))
    return found


def _root(sides: Sides, which: int | None, near: float) -> Floats:
    """Return x and w of the crossing, or of a border's turning point, nearest to a place."""
    equation = poly.polysub(*sides) if which is None else poly.polyder(sides[which])
    roots = real_roots(equation)
    x = float(roots[np.argmin(np.abs(roots - near))]) if len(roots) else np.nan
    return np.array([x, poly.polyval(x, sides[which or 0])])


def _at(mark: Callable[[Sides], Floats], n: int, x: Floats) -> Floats:
    return mark((x[:n], x[n:]))


def _draw(figure: Figure, true: Sides, found: Sides, reach: float) -> None:
    """Draw true and estimated borders, and the loops of three sines."""
    from whid.plots._style import MEASURED, MODEL, OTHER, TRUTH

    figure.set_size_inches(7.4, 5.0)
    axes = figure.subplots()
    x, turn, power = np.linspace(-1.1 * reach, 1.1 * reach, 300), 2 * np.pi * np.arange(721) / 720, np.arange(len(true[0]))
    for side, colour, name in zip(found, (MODEL, OTHER), ("rising", "falling"), strict=True):
        axes.plot(x, poly.polyval(x, side), color=colour, lw=1.8, label=f"{name} border, estimated")
    for k, side in enumerate(true):
        axes.plot(x, poly.polyval(x, side), "--", color=TRUTH, lw=1.0, label=None if k else "borders, true")
    levels = []
    for k, amplitude in enumerate(np.array(AMPLITUDES) * reach):
        w = response(true[0] * amplitude**power, true[1] * amplitude**power, turn)[0]
        levels.append(w)
        axes.plot(amplitude * np.cos(turn), w, color=MEASURED, lw=0.9, label=None if k else "loops of three amplitudes")
        for j in (60, 200, 420, 560):
            arrow(axes, amplitude * np.cos(turn), w, j, MEASURED)
    low, high = np.min(levels), np.max(levels)
    axes.set_ylim(low - 0.5 * (high - low), high + 1.0 * (high - low))
    axes.set_xlabel("x, input of the backlash, G(0) = 1")
    axes.set_ylabel("output")
    axes.set_title("Figure 1, redrawn: borders that cross and are not invertible")
    axes.legend(loc="best", fontsize=8)
    figure.tight_layout()
