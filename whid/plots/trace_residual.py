"""The residual of the declared and of the refined model: against time, against what drives the curve, in frequency."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MODEL, QUIET, TRUTH, Floats, clock, envelope, label, spaced

NEEDS = ("verdict", "left_over")
BINS = 24  # of the driving signal
COLOURS = (("before", TRUTH), ("after", MODEL))


def draw(run: Any, figure: Figure) -> None:
    """Draw four pictures: time, amplitude, up against down, spectrum."""
    found = run.stages["left_over"]
    unit = run.records[0].units["output"]
    figure.set_size_inches(8.4, 5.6)
    (time, amplitude), (branch, lines) = figure.subplots(2, 2)
    seconds, since = clock(found.time)
    for name, colour in COLOURS:
        time.plot(*envelope(seconds, getattr(found, name)), color=colour, lw=0.5, label=f"{name}")
    for side in (-2 * found.floor, 2 * found.floor):
        time.axhline(side, color="black", lw=0.7, ls=":")
    time.set_xlabel(since)
    time.set_ylabel(label("output − model", unit))
    time.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    _binned(amplitude, found, unit)
    _branches(branch, found, unit)
    _spectrum(lines, found, unit)
    spaced(figure, 2, 2, (0.85, 0.7))


def _means(v: Floats, e: Floats, on: Any) -> tuple[Floats, Floats, Floats]:
    """Return centre, mean and its standard error in bins of v that hold enough."""
    keep = on & np.isfinite(e)
    edges = np.quantile(v[keep], np.linspace(0, 1, BINS + 1)) if keep.sum() > 10 * BINS else np.empty(0)
    rows = []
    for low, high in pairwise(edges):
        inside = keep & (v >= low) & (v <= high)
        if inside.sum() >= 5:
            rows.append((v[inside].mean(), e[inside].mean(), e[inside].std() / np.sqrt(inside.sum())))
    columns = np.array(rows).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]


def _binned(axes: Axes, found: Any, unit: str) -> None:
    for name, colour in COLOURS:
        x, mean, error = _means(found.driving, getattr(found, name), np.ones(len(found.time), bool))
        axes.errorbar(x, mean, 2 * error, color=colour, lw=0.9, fmt="o-", ms=2.5, label=name)
    axes.axhline(0.0, color="black", lw=0.7)
    axes.set_xlabel("what enters the curve (without one: the output)")
    axes.set_ylabel(label("mean residual", unit))
    axes.legend(loc="best")


def _branches(axes: Axes, found: Any, unit: str) -> None:
    for on, colour, name in ((found.rising, MODEL, "v rises"), (~found.rising, TRUTH, "v falls")):
        x, mean, error = _means(found.driving, found.before, on)
        axes.errorbar(x, mean, 2 * error, color=colour, lw=0.9, fmt="o-", ms=2.5, label=name)
    axes.axhline(0.0, color="black", lw=0.7)
    axes.set_xlabel("what enters the curve (without one: the output)")
    axes.set_ylabel(label("mean residual before", unit))
    axes.legend(loc="best")


def _spectrum(axes: Axes, found: Any, unit: str) -> None:
    """Draw the spectra of the longest periodic part, the excitation's harmonics as dots; of anything else, smoothed."""
    if found.period:
        part = slice(found.start, found.start + found.period * found.periods)
        for name, colour in COLOURS:
            e = np.nan_to_num(getattr(found, name)[part])
            size = np.abs(np.fft.rfft(e))[1:] * np.sqrt(2) / len(e)
            k = np.arange(1, len(size) + 1) / found.periods
            harmonic = np.isclose(k, np.round(k))
            axes.semilogy(k[~harmonic], size[~harmonic], ".", color=QUIET, ms=1.0, zorder=0)
            axes.semilogy(k[harmonic], size[harmonic], ".", color=colour, ms=3.0, label=name)
        axes.set_xlabel("harmonic of the excitation (grey: between)")
    else:
        from scipy.signal import welch

        for name, colour in COLOURS:
            f, p = welch(np.nan_to_num(getattr(found, name)), nperseg=min(1024, len(found.time)))
            axes.semilogy(f[1:], np.sqrt(p[1:]), color=colour, lw=0.9, label=name)
        axes.set_xlabel("frequency, cycles a sample")
    axes.set_ylabel(label("amplitude", unit))
    axes.legend(loc="best")
