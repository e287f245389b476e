"""[Brouri2019], Figure 4.1: the shape of f."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from whid.blocks.piecewise import Piecewise
from whid.papers._brouri2019 import LOST, one_run, parameter, true_curve
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.quantity import Measured
from whid.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RANGE = (-3.5, 4.0)


@dataclass(frozen=True, kw_only=True)
class Brouri2019Figure41(Exhibit):
    """The true f, its breaks and jumps, and what one run finds of them ([Brouri2019], Figure 4.1).

    efficient  the whole-record fit: the output tells when v crosses a jump
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return breaks and jumps, found and true."""
        f, run = true_curve(bench), one_run(bench, whole=True)
        same = len(_curve(run).breaks) == len(f.breaks)
        rows = [
            Row(f"break {k + 1}", None, None, parameter(run, f"chain.1.breaks.{k}") if same else "not found", b)
            for k, b in enumerate(f.breaks)
        ]
        found = _jumps(run) if same else {}
        rows += [
            Row(f"jump at break {k + 1}", None, None, found.get(k, "none: a kink"), float(height))
            for k, height in enumerate(f.jumps())
        ]
        return Regenerated(
            "Figure 4.1 of Brouri, Rabyi and Ouannou (2019): shape of f, and breaks and jumps found in one run",
            rows,
            (LOST, "The paper gives no breaks, and no method for them: (4.2b) on [1, 3] is all that is printed of f."),
            draw=lambda figure: _draw(figure, f, _curve(run)),
            headings=("published", "paper's method, ours", "whole record, ours", "true"),
        )


def _curve(run: Result) -> Piecewise:
    return next(block for block in run.model.system.chain if isinstance(block, Piecewise))


def _jumps(run: Result) -> dict[int, Measured]:
    """Return the jumps of the model's curve with their standard errors, by break; a kink has none."""
    estimate, f = run.model.estimate, _curve(run)
    names = list(estimate.names)
    found = {}
    for k in np.flatnonzero(~f.kinks()):
        gradient = np.zeros(len(names))
        for sign, piece in ((1, k + 1), (-1, k)):
            for power in range(len(f.pieces[piece])):
                if (name := f"chain.1.pieces.{piece}.{power}") in names:
                    gradient[names.index(name)] = sign * f.breaks[k] ** power
        right, left = (_slope(f.pieces[p], f.breaks[k]) for p in (k + 1, k))
        gradient[names.index(f"chain.1.breaks.{k}")] = right - left
        found[int(k)] = Measured(float(f.jumps()[k]), float(np.sqrt(gradient @ estimate.covariance @ gradient)))
    return found


def _slope(piece: tuple[float, ...], at: float) -> float:
    return float(np.polynomial.Polynomial(piece).deriv()(at))


def _draw(figure: Figure, true: Piecewise, found: Piecewise) -> None:
    """Draw both curves, interrupted at the jumps."""
    from whid.plots._style import MODEL, TRUTH

    figure.set_size_inches(7.4, 4.4)
    axes = figure.subplots()
    v = np.linspace(*RANGE, 3001)
    for f, colour, style, width, label in ((found, MODEL, "-", 2.4, "found in one run"), (true, TRUTH, "--", 1.2, "true")):
        w = f.value(v)
        w[np.searchsorted(v, [b for b, kink in zip(f.breaks, f.kinks(), strict=True) if not kink])] = np.nan
        axes.plot(v, w, color=colour, ls=style, lw=width, label=label)
    for b in true.breaks:
        axes.axvline(b, color="#cccccc", lw=0.8, zorder=0)
    axes.axvspan(1, 3, color="#f2f2f2", zorder=-1)
    axes.text(2, axes.get_ylim()[0], "given in the paper", ha="center", va="bottom", fontsize=8, color="#666666")
    axes.set_xlabel("v")
    axes.set_ylabel("f(v)")
    axes.set_title("Figure 4.1, redrawn: shape of f")
    axes.legend(loc="upper left")
    figure.tight_layout()
