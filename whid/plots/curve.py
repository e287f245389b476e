"""The static curves of a parametric fit, with their bands and knots."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MODEL, TRUTH, Floats, label, spaced
from whid.plots._system import static_groups

NEEDS = ("static_curves", "model")


def draw(run: Any, figure: Figure) -> None:
    """Draw a column a curve: the curve between filters of unit static gain, below it the width of its 95 % band."""
    curves, groups = run.stages["static_curves"], static_groups(run.stages["model"].system)
    count, units = len(curves.level), run.records[0].units
    figure.set_size_inches(7.4 if count == 1 else 4.6 * count, 5.6)
    axes = figure.subplots(2, count, sharex="col", squeeze=False, height_ratios=(3, 1.25))
    true = _true_curves(run.truth, curves) if run.truth is not None else [None] * count
    for k, (above, below) in enumerate(axes.T):
        v, value, half = curves.level[k], curves.value[k], 1.96 * np.asarray(curves.std[k])
        above.fill_between(v, value - half, value + half, color=MODEL, alpha=0.25, lw=0)
        above.plot(v, value, color=MODEL, label="model, 95 % band")
        _knots(above, groups[k], v, value)
        if true[k] is not None:
            above.plot(v, true[k], color=TRUTH, ls="--", lw=1.1, label="truth")
        positive = half[half > 0]
        below.semilogy(v, np.maximum(half, positive.min() if len(positive) else 1e-300), color=MODEL)
        above.set_title("Static curve" if count == 1 else f"Curve {k + 1}")
        above.set_ylabel(label("behind the curve", units["output" if k == count - 1 else "input"]))
        below.set_xlabel(label("in front of the curve", units["input"]))
    axes[1, 0].set_ylabel("half width of the band")
    axes[0, 0].legend(loc="best")
    spaced(figure, 2, count)


def _knots(axes: Axes, group: list[Any], v: Floats, value: Floats) -> None:
    """Mark knots and corners of the first block of a curve that has some."""
    places = getattr(group[0], "inputs", None)
    at = np.array(places if places is not None else group[0].breakpoints(), float)
    at = at[(at >= v[0]) & (at <= v[-1])]
    if len(at):
        name = "knots" if places is not None else "breaks"
        axes.plot(at, np.interp(at, v, value), "o", ms=3.5, mfc="white", color=MODEL, label=name)


def _true_curves(system: Any, curves: Any) -> list[Floats | None]:
    """Return the curves of a plant of the same structure in the same gauge: unit static gain of all filters.

    Of two curves the first is known but for a line, whose inverse the second undoes: the one that takes it nearest to ours.
    """
    groups, blocks = static_groups(system), system.series
    nothing: list[Floats | None] = [None] * len(curves.level)
    if len(groups) != len(nothing) or any(not hasattr(b, "gain_at") for b in blocks if not hasattr(b, "sensitivity")):
        return nothing
    gain = [1.0]
    for b in blocks:
        if hasattr(b, "gain_at"):
            gain[-1] *= complex(b.gain_at(np.zeros(1))[0]).real
        elif b is groups[len(gain) - 1][0]:
            gain.append(1.0)
    value = _through(groups[0], gain[0] * curves.level[0])
    if len(groups) == 1:
        return [gain[1] * value]
    slope, shift = np.polyfit(value, curves.value[0], 1)
    arriving = gain[1] * (curves.level[1] - shift) / slope
    return [slope * value + shift, gain[2] * _through(groups[1], arriving)] if len(groups) == 2 else nothing


def _through(group: list[Any], v: Floats) -> Floats:
    for block in group:
        v = block.value(v)
    return v
