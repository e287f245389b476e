"""What an ingested record holds: input and output over time, its parts shaded; for `whid ingest`, not for runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.experiments._part import Part
from whid.plots._style import GAP, MEASURED, MODEL, OTHER, QUIET, envelope, label
from whid.record import Record

SHADES = {"hold": ("#eef4fa", "#dbe8f4"), "sine": ("#fbeee6", "#f6dfd0")}
OTHERS = ("#eef6f1", "#dcefe4")
MOST_LABELS = 45


def draw(record: Record, figure: Figure) -> None:
    """Draw u above y, every part shaded and, where there is room, named by its level or its period."""
    if len(record.parts) > 12:
        figure.set_size_inches(9.6, 4.8)
    upper, lower = figure.subplots(2, 1, sharex=True)
    _shade(upper, record, named=True)
    _shade(lower, record, named=False)
    upper.plot(*envelope(record.time, record.u), color=MODEL, linewidth=1.1)
    lower.plot(*envelope(record.time, record.y), color=MEASURED, linewidth=0.8)
    missing = np.flatnonzero(~record.mask)
    if len(missing):
        for run in np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)[:500]:
            lower.axvspan(record.time[run[0]], record.time[run[-1]] + record.dt, color=GAP, linewidth=0)
        lower.set_title(f"{len(missing)} outputs missing (yellow)", fontsize=8.5, color=QUIET)
    upper.set_ylabel(label("input u", record.units["input"]))
    lower.set_ylabel(label("output y", record.units["output"]))
    lower.set_xlabel("time, s")
    upper.set_xlim(record.time[0], record.time[-1] + record.dt)
    title = f"{record.name}: {len(record)} samples, dt = {record.dt:.6g} s"
    found = summary(record.parts)
    figure.suptitle(title + (f"; {found}" if found else ""), x=0.01, ha="left", fontsize=10)


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


def _shade(axes: Axes, record: Record, named: bool) -> None:
    axes.grid(False)
    few = len(record.parts) <= MOST_LABELS
    for k, part in enumerate(record.parts):
        start, stop = (record.t0 + record.dt * (n or 0) for n in (part.start, part.stop))
        axes.axvspan(start, stop, color=SHADES.get(part.kind, OTHERS)[k % 2], linewidth=0, zorder=0)
        if named and few:
            text, turn = _name(part), 90 if len(record.parts) > 12 else 0
            axes.annotate(text, ((start + stop) / 2, 1.02), xycoords=("data", "axes fraction"), ha="center", va="bottom",
                          rotation=turn, fontsize=7, color=OTHER if part.kind == "sine" else QUIET)  # fmt: skip


def _name(part: Part) -> str:
    level, period = getattr(part, "level", None), getattr(part, "period", None)
    if level is not None:
        return f"{level:.4g}"
    return f"{part.kind}\nP = {period:.6g}" if period is not None else part.kind
