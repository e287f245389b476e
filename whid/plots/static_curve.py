"""The static curve: levels with error bars, pieces, jumps and kinks, and what the pieces leave over."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import GAP, MEASURED, MODEL, OTHER, TRUTH, Floats, label, spaced
from whid.plots._system import jump_levels, steady_curve

NEEDS = ("static_curve",)
BRANCHES = ((1, "^", MEASURED, "upward"), (-1, "v", OTHER, "downward"), (0, "o", MEASURED, "levels"))


def draw(run: Any, figure: Figure) -> None:
    """Draw the curve above, the levels' distance from it below."""
    curve, pieces = run.stages["static_curve"], run.stages.get("segmentation")
    fitted = partial(_evaluate, pieces) if pieces else partial(_joined, curve)
    figure.set_size_inches(7.4, 5.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
    jumps = np.asarray(pieces.breaks)[np.asarray(pieces.jump, bool)] if pieces else np.empty(0)
    grid = _grid(curve, jumps)
    above.plot(grid, _broken(grid, fitted(grid), jumps), color=MODEL, label="pieces" if pieces else "levels joined")
    _levels(above, curve, np.zeros_like(curve.mean), 0.0)
    _levels(below, curve, fitted(np.asarray(curve.level)), 0.004 * np.ptp(curve.level))
    below.axhline(0, color=MODEL, lw=1)
    if pieces:
        _breaks(above, below, pieces)
    if run.truth is not None:
        _truth(above, below, run, curve, fitted)
    units = run.records[0].units
    above.set_ylabel(label("steady output", units["output"]))
    above.set_title("Static curve")
    below.set_ylabel(label("level − curve", units["output"]))
    below.set_xlabel(label("input level", units["input"]))
    above.legend(loc="best")
    spaced(figure, 2, 1)


def _levels(axes: Axes, curve: Any, base: Floats, aside: float) -> None:
    """Mark the levels less `base` with 95 % intervals, each branch by its own sign, `aside` of each other."""
    direction = np.sign(np.asarray(curve.direction))
    for sign, marker, colour, name in BRANCHES:
        on = direction == sign
        if on.any():
            axes.errorbar(
                curve.level[on] + sign * aside, (curve.mean - base)[on], 1.96 * np.asarray(curve.mean_std)[on], fmt=marker,
                color=colour, ms=4.5, mfc="white", elinewidth=1, capsize=2, zorder=3, label=name,
            )  # fmt: skip


def _breaks(above: Axes, below: Axes, pieces: Any) -> None:
    """Mark a jump by a line in the gap it lies in, a kink by a diamond on the curve."""
    kinds: dict[str, Any] = {}
    for k, (at, jump) in enumerate(zip(pieces.breaks, pieces.jump, strict=True)):
        if jump:
            for axes in (below, above):
                axes.axvspan(*pieces.borders[k], color=GAP, alpha=0.35, lw=0)
                kinds["jump, within the shade"] = axes.axvline(at, color="#777777", lw=0.9, ls=":")
        else:
            value = float(_evaluate(pieces, np.array([at]))[0])
            kinds["kink"] = above.errorbar(
                at, value, xerr=1.96 * pieces.break_std[k], fmt="D", color=MODEL, mfc="white", ms=6, zorder=4, capsize=2
            )
    for name, artist in kinds.items():
        artist.set_label(name)


def _truth(above: Axes, below: Axes, run: Any, curve: Any, fitted: Any) -> None:
    """Draw the truth, and below what it differs by, at the scale of the levels' scatter."""
    jumps = jump_levels(run.truth)
    grid = _grid(curve, jumps)
    truth = _broken(grid, steady_curve(run.truth, grid, run.records[0].dt), jumps)
    above.plot(grid, truth, color=TRUTH, ls="--", lw=1.1, label="truth")
    low, high = below.get_ylim()
    below.plot(grid, truth - fitted(grid), color=TRUTH, ls="--", lw=1.1)
    below.set_ylim(low, high)


def _grid(curve: Any, jumps: Floats) -> Floats:
    """Return inputs over the levels and a little beyond, with every jump and both its sides."""
    low, high = np.min(curve.level), np.max(curve.level)
    margin, near = 0.03 * (high - low), 1e-9 * (high - low)
    return np.sort(np.concatenate([np.linspace(low - margin, high + margin, 400), jumps - near, jumps, jumps + near]))


def _broken(grid: Floats, values: Floats, jumps: Floats) -> Floats:
    """Return the values with a hole at every jump: a hard nonlinearity has no vertical stroke."""
    return np.where(np.isin(grid, jumps), np.nan, values)


def _evaluate(pieces: Any, u: Floats) -> Floats:
    piece = np.searchsorted(np.asarray(pieces.breaks, float), u, side="right")
    rows = np.nan_to_num(np.asarray(pieces.coefficients, float))[piece]
    return np.asarray(np.sum(rows * np.asarray(u)[:, None] ** np.arange(rows.shape[1]), axis=1))


def _joined(curve: Any, u: Floats) -> Floats:
    level, inverse = np.unique(curve.level, return_inverse=True)
    mean = np.bincount(inverse, curve.mean) / np.bincount(inverse)
    return np.asarray(np.interp(u, level, mean))
