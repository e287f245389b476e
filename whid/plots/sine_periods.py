"""One period of every sine: the output averaged over the periods, and the model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MEASURED, MODEL, QUIET, Floats, label, spaced

NEEDS = ("residuals", "sine")
MOST = 8  # sines in one picture


class Fold(NamedTuple):
    """A sine folded on its period: bins of phase, the mean output and model there, the error of the mean."""

    phase: Floats  # (n,) 0 … 1
    mean: Floats
    std: Floats
    model: Floats
    title: str


def draw(run: Any, figure: Figure) -> None:
    """Draw a column a sine: output and model above, their difference below."""
    folds = list(_folds(run))
    shown = folds[:MOST]
    columns = min(len(shown), 4 if len(shown) in (4, 7, 8) else 3)
    rows = -(-len(shown) // columns)
    figure.set_size_inches(max(0.8 + 2.6 * columns, 4.5), 0.6 + 3.6 * rows)
    axes = figure.subplots(2 * rows, columns, sharex=True, squeeze=False, height_ratios=(2.4, 1) * rows)
    units = run.records[0].units
    for k, fold in enumerate(shown):
        _one(axes[2 * (k // columns), k % columns], axes[2 * (k // columns) + 1, k % columns], fold)
    for k in range(len(shown), rows * columns):
        axes[2 * (k // columns), k % columns].axis("off")
        axes[2 * (k // columns) + 1, k % columns].axis("off")
    for row in range(rows):
        axes[2 * row, 0].set_ylabel(label("output", units["output"]))
        axes[2 * row + 1, 0].set_ylabel(label("output − model", units["output"]))
    for column in range(min(columns, len(shown))):
        lowest = 2 * ((len(shown) - 1 - column) // columns) + 1
        axes[lowest, column].set_xlabel("time / period")
        axes[lowest, column].tick_params(labelbottom=True)
    shown_of = f"the first {MOST} of {len(folds)} sines" if len(folds) > MOST else None
    curves, noise = (ax.get_legend_handles_labels() for ax in axes[:2, 0])
    figure.legend(curves[0] + noise[0], curves[1] + noise[1], loc="upper center", ncols=3, title=shown_of)
    spaced(figure, 2 * rows, columns, (0.6, 0.3), 0.75 if shown_of else 0.6)


def _one(upper: Axes, lower: Axes, fold: Fold) -> None:
    upper.plot(fold.phase, fold.mean, ".", color=MEASURED, ms=2.5, label="measured, mean of periods")
    upper.plot(fold.phase, fold.model, color=MODEL, lw=1.2, label="model")
    upper.set_title(fold.title, fontsize=9)
    lower.axhline(0, color=MODEL, lw=1)
    lower.fill_between(
        fold.phase, -1.96 * fold.std, 1.96 * fold.std, color=QUIET, alpha=0.3, lw=0, label="95 % of the noise of a mean"
    )
    lower.plot(fold.phase, fold.mean - fold.model, ".", color=MEASURED, ms=2.5)


def _folds(run: Any) -> Iterator[Fold]:
    """Yield every sine of every record, its lead periods left out."""
    for record, residual in zip(run.records, run.residuals, strict=True):
        for part in record.parts:
            if part.kind == "sine" and part.start is not None:
                start = part.start + round(part.lead_periods * part.period)
                y, e = record.y[start : part.stop], residual[start : part.stop]
                use = "" if part.use == "estimation" else f" ({part.use})"
                if np.isfinite(e).any():
                    yield _fold(y, e, part.period, f"ω = {part.radians(record.dt):.3g} rad/s at {part.offset:.4g}" + use)


def _fold(y: Floats, residual: Floats, period: float, title: str) -> Fold:
    """Average in bins of phase, a sample a bin where the period is short."""
    bins = round(period / np.ceil(period / 400))
    turn = np.arange(len(y)) / period % 1
    index = np.minimum((turn * bins + 1e-6).astype(int), bins - 1)
    known = np.isfinite(residual) & np.isfinite(y)
    count = np.maximum(np.bincount(index[known], minlength=bins), 1)

    def mean(x: Floats) -> Floats:
        return np.asarray(np.bincount(index[known], x[known], minlength=bins) / count)

    scatter = mean(residual**2) - mean(residual) ** 2
    pooled = np.sqrt(np.mean(scatter * count / np.maximum(count - 1, 1)))
    return Fold(mean(turn), mean(y), pooled / np.sqrt(count), mean(y - residual), title)
