"""What an ingested record holds: input and output over time, its parts shaded; for `whid ingest`, not for runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.experiments._part import Part
from whid.plots._style import GAP, MEASURED, MODEL, QUIET, clock, envelope, label
from whid.record import Record

SHADES = {"hold": ("#eef4fa", "#dbe8f4"), "sine": ("#fbeee6", "#f6dfd0")}
OTHERS = ("#eef6f1", "#dcefe4")
MOST_LABELS, NARROW = 60, 0.008  # parts, share of the record: beyond, names would overlap


def draw(record: Record, figure: Figure) -> None:
    """Draw u above y, every part shaded and, where there is room, named by its level or its period."""
    if len(record.parts) > 12:
        figure.set_size_inches(9.6, 4.8)
    figure.set_layout_engine("none")  # it would make room for names of parts that hang over the edges
    figure.subplots_adjust(left=0.09, right=0.985, bottom=0.1, top=0.87, hspace=0.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    time, name = clock(record.time)
    _shade(upper, record, time[0], named=True)
    _shade(lower, record, time[0], named=False)
    upper.plot(*envelope(time, record.u), color=MODEL, linewidth=1.1)
    lower.plot(*envelope(time, record.y), color=MEASURED, linewidth=0.8)
    missing = np.flatnonzero(~record.mask)
    if len(missing):
        for run in np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)[:500]:
            lower.axvspan(time[run[0]], time[run[-1]] + record.dt, color=GAP, linewidth=0)
        lower.set_title(f"{len(missing)} outputs missing (yellow)", fontsize=8.5, color=QUIET)
    upper.set_ylabel(label("input u", record.units["input"]))
    lower.set_ylabel(label("output y", record.units["output"]))
    lower.set_xlabel(name)
    upper.set_xlim(time[0], time[-1] + record.dt)
    title = f"{record.name}: {len(record)} samples, dt = {record.dt:.6g} s"
    found = summary(record.parts)
    upper.set_title(title + (f"; {found}" if found else ""), pad=32 if record.parts else 6)


def summary(parts: Sequence[Part]) -> str:
    """Return how many parts of each kind there are, in words.

    >>> from whid.experiments.hold import Hold
    >>> summary([Hold(level=0.0, hold_s=1.0), Hold(level=1.0, hold_s=1.0)])
    '2 holds'
    """
    kinds = [part.kind for part in parts]
    return ", ".join(
        f"{kinds.count(k)} {k}{'' if kinds.count(k) == 1 or k[-1] == 's' else 's'}" for k in dict.fromkeys(kinds)
    )


def _shade(axes: Axes, record: Record, begin: float, named: bool) -> None:
    axes.grid(False)
    few = len(record.parts) <= MOST_LABELS
    digits = 2 - int(np.floor(np.log10(np.ptp(record.u))))  # names to a hundredth of the range
    for k, part in enumerate(record.parts):
        start, stop = (begin + record.dt * (n or 0) for n in (part.start, part.stop))
        axes.axvspan(start, stop, color=SHADES.get(part.kind, OTHERS)[k % 2], linewidth=0, zorder=0)
        if named and few and part.length > NARROW * len(record):
            level, period = getattr(part, "level", None), getattr(part, "period", None)
            text = part.kind if period is None else f"P = {period:.4g}"
            if level is not None:
                text = f"{round(level, digits) + 0.0:g}"
            axes.annotate(text, ((start + stop) / 2, 1.02), xycoords=("data", "axes fraction"), ha="center", va="bottom",
                          rotation=90 if level is not None else 0, fontsize=7.5, color=QUIET)  # fmt: skip
