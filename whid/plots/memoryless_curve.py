"""A curve without memory: what was measured, the nodes, and how far the estimates differ."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from whid.plots._style import MEASURED, MODEL, OTHER, QUIET, TRUTH, label, spaced
from whid.stages._chebyshev import basis

NEEDS = ("curve_estimates", "model")
POINTS = 4000  # samples drawn
ESTIMATES = (("node_windows", OTHER, "as in the paper"), ("node_plus", "#CC79A7", "node-plus"))


def draw(run: Any, figure: Figure) -> None:
    """Draw the curve above; below, the other estimates and the truth minus the reported one, with its 95 % band."""
    curve, units = run.stages["curve_estimates"], run.records[0].units
    low, high = map(float, curve.domain)
    t = np.cos(np.linspace(np.pi, 0, 401))
    x, rows = (low + high) / 2 + t * (high - low) / 2, basis(t, len(curve.bound) - 1)
    reported = np.asarray(getattr(curve, curve.reported))
    figure.set_size_inches(7.4, 5.8)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    for record in run.records:
        used = np.flatnonzero(record.using("estimation"))
        some = used[:: max(1, len(used) // POINTS)]
        above.plot(record.u[some], record.y[some], ".", ms=1.5, color=QUIET, alpha=0.5, rasterized=True)
    above.plot([], [], ".", ms=4, color=QUIET, label="measured")
    above.plot(x, reported @ rows, color=MODEL, label="model")
    if "node_windows" in run.stages:
        nodes = run.stages["node_windows"]
        above.plot(nodes.node, nodes.value, "o", ms=4.5, mfc="white", color=MEASURED, label="Chebyshev nodes")
    half = 1.96 * np.sqrt(np.einsum("jn,jk,kn->n", rows, np.asarray(curve.covariance), rows))
    below.fill_between(x, -half, half, color=MODEL, alpha=0.25, lw=0, label="95 % band of the model")
    below.axhline(0, color=MODEL)
    for name, colour, words in ESTIMATES:
        other = np.asarray(getattr(curve, name))
        if name != curve.reported and np.isfinite(other).all():
            below.plot(x, (other - reported) @ rows, color=colour, lw=1.0, label=words)
    true = _true(run, x)
    if true is not None:
        above.plot(x, true, color=TRUTH, ls="--", lw=1.1, label="truth")
        below.plot(x, true - reported @ rows, color=TRUTH, ls="--", lw=1.1, label="truth")
    above.set_title("Curve without memory")
    above.set_ylabel(label("output", units["output"]))
    above.set_xlim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    inside = (reported @ rows).min(), (reported @ rows).max()
    above.set_ylim(inside[0] - 0.2 * (inside[1] - inside[0]), inside[1] + 0.2 * (inside[1] - inside[0]))
    below.set_ylabel(label("minus the model", units["output"]))
    below.set_xlabel(label("input", units["input"]))
    above.legend(loc="upper left")
    below.legend(loc="best", ncols=2)
    spaced(figure, 2, 1)


def _true(run: Any, x: Any) -> Any:
    if run.truth is None or not all(hasattr(block, "sensitivity") for block in run.truth.series):
        return None
    return run.truth.tree(x, run.records[0].dt, between="discrete")
