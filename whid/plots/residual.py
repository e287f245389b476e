"""What the model leaves over, against time, and its spectrum beside the output's."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MODEL, QUIET, TRUTH, Floats, clock, envelope, label, log_ticks, note, spaced

NEEDS = ("residuals",)
USES = {"estimation": MODEL, "selection": "#009E73", "report": TRUTH}
MOST = 3  # records in one picture
SLOW = 200  # stretches whose means are drawn over a long residual


def draw(run: Any, figure: Figure) -> None:
    """Draw a row a record: the residual over time on the left, the two spectra on the right."""
    shown = [(r, e) for r, e in zip(run.records, run.residuals, strict=True) if np.isfinite(e).sum() > 1][:MOST]
    figure.set_size_inches(8.4, 1.2 + 2.3 * len(shown))
    thin = all(getattr(record, "every", 1) > 1 for record, _ in shown)
    axes = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(1.5, 1e-3 if thin else 1))
    for (left, right), (record, residual) in zip(axes, shown, strict=True):
        _course(left, record, residual)
        if getattr(record, "every", 1) == 1:
            _spectra(right, record, residual)
        else:  # a spectrum of every so many-th sample would be folded
            right.axis("off")
            left.set_title(f"{record.name}: every {record.every}th of {record.samples:.4g} samples")
    axes[-1, 1].set_xlabel("frequency, rad/s")
    spaced(figure, len(shown), 2, (0.85, 0.0 if thin else 0.6))


def _course(axes: Axes, record: Any, residual: Floats) -> None:
    """Draw the residual, each use in its own colour."""
    time, name = clock(record.time)
    for use, colour in USES.items():
        on = record.using(use) & np.isfinite(residual)
        if on.any():
            axes.plot(*envelope(time, np.where(on, residual, np.nan)), color=colour, lw=0.5, label=use)
    rest = ~np.any([record.using(use) for use in USES], axis=0) & np.isfinite(residual)
    if rest.any():
        axes.plot(*envelope(time, np.where(rest, residual, np.nan)), color=QUIET, lw=0.5, label="in no part")
    if len(residual) > 100 * SLOW:
        axes.plot(*_slow(time, residual), color="black", lw=0.9, label=f"mean of 1/{SLOW}")
    axes.set_xlabel(name)
    axes.set_ylabel(label("output − model", record.units["output"]))
    axes.set_title(record.name)
    used = np.any([record.using(use) for use in USES], axis=0) & np.isfinite(residual)
    known = residual[used if used.any() else np.isfinite(residual)]
    note(axes, f"rms {np.sqrt(np.mean(known**2)):.3g}, output std {np.nanstd(record.y):.3g}")
    if rest.any():  # what belongs to no part may be a transient; it does not set the scale
        largest = 1.2 * float(np.abs(known).max()) or 1.0
        axes.set_ylim(-largest, largest)
    if [line.get_label() for line in axes.lines] != ["estimation"]:
        axes.legend(loc="upper left", ncols=2, framealpha=0.8)


def _slow(time: Floats, residual: Floats) -> tuple[Floats, Floats]:
    """Return means over stretches: drift, which no model of the input can follow."""
    known = np.isfinite(residual)
    parts = np.array_split(np.arange(len(residual)), SLOW)
    return np.array([time[p].mean() for p in parts]), np.array(
        [residual[p][known[p]].mean() if known[p].any() else np.nan for p in parts]
    )


def _spectra(axes: Axes, record: Any, residual: Floats) -> None:
    from scipy.signal import welch

    known = np.isfinite(residual)
    length = int(min(max(256, len(residual) // 16), 1 << 14, len(residual)))
    for x, colour, name in ((record.y, QUIET, "output"), (residual, MODEL, "residual")):
        filled = np.where(known, x, np.mean(x[known]))
        frequency, density = welch(filled, 1 / record.dt, nperseg=length, detrend="constant")
        axes.loglog(2 * np.pi * frequency[1:-1], np.sqrt(density[1:-1] / (2 * np.pi)), color=colour, lw=0.9, label=name)
    for axis in (axes.xaxis, axes.yaxis):
        log_ticks(axis)
    axes.set_ylabel(f"density, {record.units['output']}/√(rad/s)")
    axes.legend(loc="best")
