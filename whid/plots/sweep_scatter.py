"""A sweep's scatter over one swept number: RMSE of each estimate with the Cramér-Rao bound in, or of each error its mean."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import QUIET, Floats, log_ticks, spaced
from whid.signal import rms

NEEDS = ("swept",)
MOST = 6  # lines a panel
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # Okabe and Ito


def draw(run: Any, figure: Figure) -> None:
    """Draw gains and phases apart (RMSE and bound), below or alone the metrics of `expect:`, over the first swept number."""
    path = run.swept[0]
    x = np.array(run.over[path], float)
    panels = _panels(run)
    figure.set_size_inches(7.4, 3.0 * len(panels) + 0.6)
    axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    for ax, (title, names) in zip(axes, panels.items(), strict=True):
        for color, name in zip(COLORS, names, strict=False):
            _line(ax, run, name, x, color)
        ax.set_title(title)
        log = np.all(x > 0)
        ax.set_xscale("log" if log else "linear")
        ax.set_yscale("log")
        if log:
            log_ticks(ax.xaxis)
        log_ticks(ax.yaxis)
        ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    axes[-1].set_xlabel(path)
    spaced(figure, len(panels), 1, between=(0.8, 0.45))
    figure.subplots_adjust(right=0.72)


def _panels(run: Any) -> dict[str, list[str]]:
    """Return the metrics of each panel: estimates by their kind, then what is expected."""
    gains, phases = (
        [n for n in run.bound if n.startswith((f"front.{what}@", f"back.{what}@"))] for what in ("gain", "phase")
    )
    errors = list(dict.fromkeys(bound.metric for bound in run.expect if bound.metric in run.values))
    rest = [n for n in run.values if n.endswith((".max", ".rms"))]
    found = {
        "RMSE of gains; dashed: Cramér-Rao bound of the whole record": gains[:MOST],
        "RMSE of phases, rad; dashed: Cramér-Rao bound of the whole record": phases[:MOST],
        "mean of each metric, 5 % to 95 % shaded": (errors or rest)[:MOST],
    }
    return {title: names for title, names in found.items() if names}


def _line(ax: Axes, run: Any, name: str, x: Floats, color: str) -> None:
    places, where = np.unique(x, return_inverse=True)
    if name in run.bound:
        error = run.values[name] - run.truth[name][:, None]
        rmse, limit = (np.array([rms(e[where == k]) for k in range(len(places))]) for e in (error, run.bound[name]))
        count = np.array([max(np.isfinite(error[where == k]).sum(), 1) for k in range(len(places))])
        ax.errorbar(places, rmse, rmse / np.sqrt(2 * count), fmt="o", color=color, capsize=2, label=name)
        ax.plot(places, limit, "--", color=color, lw=1.0)
        return
    cells = [run.values[name][where == k].ravel() for k in range(len(places))]
    cells = [cell[np.isfinite(cell)] for cell in cells]
    low, mean, high = (np.array([f(c) if len(c) else np.nan for c in cells]) for f in (_low, np.mean, _high))
    ax.fill_between(places, low, high, color=color, alpha=0.18, lw=0)
    ax.plot(places, mean, "o-", color=color, label=name)
    for bound in run.expect:
        if bound.metric == name and bound.below is not None:
            ax.axhline(bound.below, color=QUIET, lw=0.9, ls=":")


def _low(x: Floats) -> float:
    return float(np.quantile(x, 0.05))


def _high(x: Floats) -> float:
    return float(np.quantile(x, 0.95))
