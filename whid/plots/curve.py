"""The static curve of a parametric fit, with its band and its knots."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from whid.plots._style import MODEL, TRUTH, label

NEEDS = ("descent", "model")


def draw(run: Any, figure: Figure) -> None:
    """Draw f between the filters, both of unit static gain, and below it the width of its 95 % band."""
    model, units = run.stages["model"], run.records[0].units
    place, curve = next((k, b) for k, b in enumerate(model.system.series) if hasattr(b, "sensitivity"))
    names, prefix = [p.name for p in curve.parameters()], f"{model.system.series_path}{place}."
    at = [model.estimate.names.index(prefix + name) for name in names]
    v = np.linspace(curve.inputs[0], curve.inputs[-1], 600)
    rates = np.array([curve.sensitivity(v, name) for name in names])
    variance = np.einsum("pv,pq,qv->v", rates, np.asarray(model.estimate.covariance)[np.ix_(at, at)], rates)
    half = 1.96 * np.sqrt(np.maximum(variance, 0.0))
    figure.set_size_inches(7.4, 5.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
    above.fill_between(v, curve.value(v) - half, curve.value(v) + half, color=MODEL, alpha=0.25, lw=0)
    above.plot(v, curve.value(v), color=MODEL, label="model, 95 % band")
    above.plot(curve.inputs, curve.value(np.array(curve.inputs)), "o", ms=3.5, mfc="white", color=MODEL, label="knots")
    if run.truth is not None and (true := _true_curve(run.truth)) is not None:
        above.plot(v, true(v), color=TRUTH, ls="--", lw=1.1, label="truth")
    below.semilogy(v, np.maximum(half, 1e-300), color=MODEL)
    above.set_title("Static curve")
    above.set_ylabel(label("behind the curve", units["output"]))
    below.set_ylabel("half width of the band")
    below.set_xlabel(label("in front of the curve", units["input"]))
    above.legend(loc="best")


def _true_curve(system: Any) -> Any:
    """Return f of a plant in the same gauge: unit static gain of what stands in front and behind."""
    blocks = system.series
    static = [k for k, b in enumerate(blocks) if hasattr(b, "sensitivity")]
    if len(static) != 1 or not all(hasattr(b, "gain_at") for k, b in enumerate(blocks) if k not in static):
        return None
    front, back = (
        np.prod([complex(b.gain_at(np.zeros(1))[0]).real for b in part])
        for part in (blocks[: static[0]], blocks[static[0] + 1 :])
    )
    return lambda v: back * blocks[static[0]].value(front * v)
