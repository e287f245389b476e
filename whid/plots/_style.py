"""One quiet style for every picture: black is measured, blue is the model, dashed vermilion the truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from whid.quantity import moment

Floats = NDArray[np.float64]

MEASURED, MODEL, TRUTH, OTHER, QUIET = "black", "#0072B2", "#D55E00", "#009E73", "#8a8a8a"  # Okabe and Ito
GAP = "#F0E442"
SETTINGS: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "lines.markersize": 4,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 6),
    "path.simplify": True,
}
DPI = 160
CALENDAR = 1000  # durations of a record between zero and its start: beyond, ticks would be ten digits long
COLUMNS = 1500  # of a picture: a longer record is drawn by its lowest and highest value in each


def save(draw: Callable[[Any, Figure], None], run: Any, path: Path) -> None:
    """Draw into a new figure in the house style and write it as PNG."""
    with matplotlib.rc_context(SETTINGS):
        figure = Figure(figsize=(7.4, 4.8))
        FigureCanvasAgg(figure)
        draw(run, figure)
        figure.savefig(path, dpi=DPI)


def spaced(figure: Figure, rows: int, columns: int, between: tuple[float, float] = (0.8, 0.15), top: float = 0.35) -> None:
    """Set margins and gaps in inches; matplotlib's own layouts look nicer by a hair and take as long as the picture."""
    width, height = figure.get_size_inches()
    left, right, bottom = 0.85, 0.15, 0.55
    across, down = between
    wide = (width - left - right - (columns - 1) * across) / columns
    high = (height - bottom - top - (rows - 1) * down) / rows
    figure.subplots_adjust(
        left / width, bottom / height, 1 - right / width, 1 - top / height, wspace=across / wide, hspace=down / high
    )
    for axes in figure.axes:  # names of axes stand in line
        axes.yaxis.set_label_coords(-0.68 / axes.bbox.width * figure.dpi, 0.5)


def label(what: str, unit: str) -> str:
    """Return an axis label; a number without a unit has none in brackets.

    >>> label("output", "V"), label("output", "1")
    ('output, V', 'output')
    """
    return what if unit in ("", "1") else f"{what}, {unit}"


def clock(time: Floats) -> tuple[Floats, str]:
    """Return times to draw and the name of their axis: seconds since the first where the times are a calendar's.

    >>> clock(np.array([1709632800.0, 1709632800.5])), clock(np.array([5.0, 6.0]))
    ((array([0. , 0.5]), 'time since 2024-03-05 10:00:00 UTC, s'), (array([5., 6.]), 'time, s'))
    """
    if len(time) and abs(time[0]) > CALENDAR * (time[-1] - time[0]):
        return time - time[0], f"time since {moment(time[0]).removesuffix(' s')}, s"
    return time, "time, s"


def envelope(x: Floats, y: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
    """Return a line that looks the same on paper: of a long signal the lowest and highest value in every column.

    >>> envelope(np.arange(6.0), np.array([0.0, 5.0, 1.0, 2.0, -3.0, 4.0]), columns=2)[1]
    array([ 0.,  5., -3.,  4.])
    """
    step = len(y) // columns
    if step < 3:
        return x, y
    whole = len(y) // step * step
    blocks = y[:whole].reshape(-1, step)
    pairs = np.stack([np.fmin.reduce(blocks, axis=1), np.fmax.reduce(blocks, axis=1)], axis=1)  # NaN where all are
    return np.repeat(x[:whole:step], 2), pairs.ravel()


def log_ticks(axis: Axis) -> None:
    """Write plain numbers on a logarithmic axis: at 1, 2, 5 where it spans less than three decades."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 1000 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())  # minor ticks cost more time than everything else in a picture


def note(axes: Axes, text: str) -> None:
    """Write a small remark into the upper right corner."""
    axes.annotate(text, (1, 1), xycoords="axes fraction", ha="right", va="bottom", fontsize=8.5, color="#444444")
