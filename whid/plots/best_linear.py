"""Best linear approximation: gain over the levels of noise and distortion, phase, the rational fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MEASURED, MODEL, OTHER, QUIET, TRUTH, Floats, label, log_ticks, note, spaced

NEEDS = ("best_linear",)
DECADE = 10.0  # of frequency, beyond which the axis is logarithmic


def draw(run: Any, figure: Figure) -> None:
    """Draw |G|, the total and the noise level in dB above, the phase below, the rational fit over both."""
    bla, fit = run.stages["best_linear"], run.stages.get("linear_fit")
    figure.set_size_inches(7.4, 5.8)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    w, g = bla.omega, bla.response
    above.plot(w, _db(np.abs(g)), color=MEASURED, lw=0, marker=".", ms=3, label="best linear approximation")
    total = np.sqrt(2) * bla.std  # of a complex number, both parts
    known = bool(np.isfinite(bla.noise).all())
    above.plot(w, _db(total), color=TRUTH, lw=1, label="standard error: noise and distortion" if known else "standard error")
    if known:
        above.plot(w, _db(np.sqrt(2) * bla.noise), color=OTHER, lw=1, label="of it noise")
    phase = np.degrees(np.unwrap(np.angle(g)))
    if fit is not None:
        h = response(fit, w)
        course = np.degrees(np.unwrap(np.angle(h)))
        phase = course + np.degrees(np.angle(g / h))  # no whole turns where the response is lost in noise
        above.plot(w, _db(np.abs(h)), color=MODEL, lw=1.2, label=f"rational fit, poles: {len(fit.poles)}")
        above.plot(w, _db(np.abs(g - h)), color=QUIET, lw=0, marker=".", ms=2, zorder=1, label="measured − fit")
        below.plot(w, course, color=MODEL, lw=1.2)
    below.plot(w, phase, color=MEASURED, lw=0, marker=".", ms=3, zorder=1)
    _levels(above, bla, total, known)
    units = run.records[0].units
    above.set_ylabel(label("gain, dB re 1", _per(units["output"], units["input"])))
    below.set_ylabel("phase, °")
    below.set_xlabel("frequency, rad/s")
    if w[-1] > DECADE * w[0]:
        below.set_xscale("log")
        log_ticks(below.xaxis)
    above.legend(loc="lower left", ncols=2, framealpha=0.85, frameon=True, edgecolor="none")
    low, high = above.get_ylim()
    above.set_ylim(low - 0.22 * (high - low), high)  # room for the legend
    spaced(figure, 2, 1, (0.65, 0.15))


def _levels(axes: Axes, bla: Any, total: Floats, known: bool) -> None:
    """Say how far below the gain the levels lie."""
    said = f"{bla.averages} averages; in the median the error is {_side(total / np.abs(bla.response))} the gain"
    if known:
        said += (
            f", distortion {_side(np.sqrt(np.maximum(bla.std**2 - bla.noise**2, 1e-12 * bla.noise**2)) / bla.noise)} noise"
        )
    note(axes, said)


def _side(ratio: Floats) -> str:
    level = float(np.median(_db(ratio)))
    return f"{abs(level):.0f} dB {'above' if level > 0 else 'below'}"


def _per(output: str, input_: str) -> str:
    return "1" if output == input_ else f"{output}/{input_}"


def _db(size: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(size))


def response(fit: Any, omega: Floats) -> Any:
    """Return the rational fit on the unit circle: gain at frequency zero, zeros and poles in z."""
    back = np.exp(-1j * omega * fit.dt)

    def factors(roots: Any) -> Any:
        return np.prod((1 - roots[:, None] * back) / (1 - roots[:, None]), axis=0)

    return fit.gain * factors(fit.zeros) / factors(fit.poles)
