"""What every effect would gain, against what chance gives."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from whid.plots._style import MODEL, QUIET, TRUTH

NEEDS = ("verdict", "ranking")
MOST = 14  # effects of the first round


def draw(run: Any, figure: Figure) -> None:
    """Draw the first round: bars of nats, refitted ones filled, the needed gain as a line."""
    ranking = run.stages["ranking"]
    shown = len(ranking.effect[:MOST])
    figure.set_size_inches(7.2, 0.9 + 0.27 * shown)
    axes = figure.subplots()
    fitted = np.isfinite(ranking.gain[:MOST])
    best = np.where(fitted, ranking.gain[:MOST], ranking.screened[:MOST])
    floor = 1.0  # nat: what is less is shown as that
    place = np.arange(shown)[::-1]
    taken = np.array([name == ranking.taken for name in ranking.effect[:MOST]])
    for mask, colour, label in (
        (fitted & taken, TRUTH, "added"), (fitted & ~taken, MODEL, "refitted"), (~fitted, QUIET, "by score only"),
    ):  # fmt: skip
        if mask.any():
            axes.barh(place[mask], np.maximum(best[mask], floor), color=colour, height=0.7, label=label)
    for k in np.flatnonzero(best < 1.2 * floor):  # a bar without length says nothing
        axes.annotate(f"{best[k]:.1f}", (floor, place[k]), (4, 0), textcoords="offset points", va="center", fontsize=7.5,
                      color=QUIET)  # fmt: skip
    axes.axvline(ranking.needed, color="black", lw=0.9, ls="--", label=f"needed: {ranking.needed:.3g} nat")
    axes.set_xscale("log")
    axes.set_xlim(floor, max(2.0 * float(best.max(initial=1.0)), 20.0))
    axes.set_yticks(place, ranking.effect[:MOST])
    axes.set_xlabel("gain in log-likelihood, penalties paid, nat")
    axes.legend(loc="lower left", bbox_to_anchor=(-0.45, 1.0), ncols=4)
    figure.subplots_adjust(
        left=0.31, right=0.97, top=1 - 0.35 / figure.get_figheight(), bottom=0.55 / figure.get_figheight()
    )
