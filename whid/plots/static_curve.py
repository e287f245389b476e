"""The static curve: levels with error bars, pieces, jumps and kinks, and what the pieces leave over."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MEASURED, MODEL, OTHER, TRUTH, Floats, label
from whid.plots._system import steady_curve

NEEDS = ("static_curve",)
BRANCHES = ((1, "^", MEASURED, "upward"), (-1, "v", OTHER, "downward"), (0, "o", MEASURED, "levels"))


def draw(run: Any, figure: Figure) -> None:
    """Draw the curve above, the levels' distance from it below."""
    curve, pieces = run.stages["static_curve"], run.stages.get("segmentation")
    units, dt = run.records[0].units, run.records[0].dt
    grid = _grid(curve, pieces)
    reference = pieces and (lambda u: _evaluate(pieces, u)) or (lambda u: _joined(curve, u))
    figure.set_size_inches(7.4, 5.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
    if run.truth is not None:
        above.plot(
            grid, _broken(grid, steady_curve(run.truth, grid, dt), pieces), color=TRUTH, ls="--", lw=1.1, label="truth"
        )
    above.plot(grid, _broken(grid, reference(grid), pieces), color=MODEL, label="pieces" if pieces else "levels joined")
    _levels(above, curve, np.zeros_like(curve.mean), "")
    above.set_ylabel(label("steady output", units["output"]))
    above.set_title("Static curve")
    if pieces:
        _breaks(above, below, pieces, _evaluate)
    _levels(below, curve, reference(np.asarray(curve.level)), "_")
    below.axhline(0, color=MODEL, lw=1)
    if run.truth is not None:
        _truth_below(below, run, grid, reference, dt)
    below.set_ylabel(label("level − curve", units["output"]))
    below.set_xlabel(label("input level", units["input"]))
    above.legend(loc="best")


def _levels(axes: Axes, curve: Any, base: Floats, hide: str) -> None:
    """Mark the levels less `base` with 95 % intervals, each branch by its own sign."""
    direction = np.sign(np.asarray(curve.direction))
    for sign, marker, colour, name in BRANCHES:
        on = direction == sign
        if on.any():
            error = 1.96 * np.asarray(curve.mean_std)[on]
            shift = 0.0 if not hide else sign * 0.004 * np.ptp(curve.level)  # side by side, not on top of each other
            axes.errorbar(
                curve.level[on] + shift, (curve.mean - base)[on], error, fmt=marker, color=colour, ms=4.5, mfc="white",
                elinewidth=1, capsize=2, zorder=3, label=f"{hide}{name}",
            )  # fmt: skip


def _breaks(above: Axes, below: Axes, pieces: Any, evaluate: Any) -> None:
    """Mark a jump by a shaded gap and a line, a kink by a diamond on the curve."""
    kinds: dict[str, Any] = {}
    for k, (at, jump) in enumerate(zip(pieces.breaks, pieces.jump, strict=True)):
        if jump:
            for axes in (above, below):
                axes.axvspan(*pieces.borders[k], color="#f0e442", alpha=0.35, lw=0)
                line = axes.axvline(at, color="#777777", lw=0.9, ls=":")
            kinds["jump, somewhere in the shade"] = line
        else:
            value = float(evaluate(pieces, np.array([at]))[0])
            kinds["kink"] = above.errorbar(
                at, value, xerr=1.96 * pieces.break_std[k], fmt="D", color=MODEL, mfc="white", ms=6, zorder=4, capsize=2
            )
    for name, artist in kinds.items():
        artist.set_label(name)


def _truth_below(axes: Axes, run: Any, grid: Floats, reference: Any, dt: float) -> None:
    """Draw the truth less the curve at the scale of the levels' scatter."""
    low, high = axes.get_ylim()
    pieces = run.stages.get("segmentation")
    axes.plot(grid, _broken(grid, steady_curve(run.truth, grid, dt) - reference(grid), pieces), color=TRUTH, ls="--", lw=1.1)
    axes.set_ylim(low, high)


def _grid(curve: Any, pieces: Any) -> Floats:
    """Return inputs over the levels and a little beyond, both sides of every break included."""
    low, high = np.min(curve.level), np.max(curve.level)
    margin = 0.03 * (high - low)
    breaks = np.asarray(pieces.breaks, float) if pieces else np.empty(0)
    edges = np.concatenate([breaks - 1e-9 * (high - low), breaks, breaks + 1e-9 * (high - low)])
    return np.sort(np.concatenate([np.linspace(low - margin, high + margin, 400), edges]))


def _broken(grid: Floats, values: Floats, pieces: Any) -> Floats:
    """Return the values with a gap at every jump: a hard nonlinearity has no vertical stroke."""
    out = np.array(values, float)
    if pieces:
        out[np.isin(grid, np.asarray(pieces.breaks)[np.asarray(pieces.jump, bool)])] = np.nan
    return out


def _evaluate(pieces: Any, u: Floats) -> Floats:
    piece = np.searchsorted(np.asarray(pieces.breaks, float), u, side="right")
    rows = np.nan_to_num(np.asarray(pieces.coefficients, float))[piece]
    return np.asarray(np.sum(rows * np.asarray(u)[:, None] ** np.arange(rows.shape[1]), axis=1))


def _joined(curve: Any, u: Floats) -> Floats:
    level, inverse = np.unique(curve.level, return_inverse=True)
    mean = np.bincount(inverse, curve.mean) / np.bincount(inverse)
    return np.asarray(np.interp(u, level, mean))
