"""Gain and phase of the linear blocks in front of and behind the nonlinearity, with bands and measured points."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MEASURED, MODEL, TRUTH, Floats
from whid.plots._system import gain, gain_and_band, linear_blocks

NEEDS = ("model",)
POINTS = "joint"  # the stage with the responses at the measured frequencies


def draw(run: Any, figure: Figure) -> None:
    """Draw one column a side that has linear blocks: gain above, phase below."""
    model = run.stages["model"]
    sides = [side for side in ("front", "back") if linear_blocks(model.system, side)]
    if not sides:
        figure.text(0.5, 0.5, "the model has no linear block", ha="center")
        return
    figure.set_size_inches(3.9 * max(len(sides), 1.5), 5.2)
    axes = figure.subplots(2, len(sides), sharex="col", squeeze=False)
    for (upper, lower), side in zip(axes.T, sides, strict=True):
        _side(upper, lower, run, side)
        upper.set_title(f"{side.capitalize()} block")
    axes[0, 0].set_ylabel("gain, relative to zero frequency")
    axes[1, 0].set_ylabel("phase, degrees")
    axes[0, 0].legend(loc="lower left")


def _side(upper: Axes, lower: Axes, run: Any, side: str) -> None:
    model, points = run.stages["model"], _points(run, side)
    places = linear_blocks(model.system, side)
    omega = _frequencies(model.system, places, points, run.records[0].dt)
    g, std = gain_and_band(model, places, omega)
    _curves(upper, lower, omega, g, color=MODEL, label="model, 95 % band")
    phase = np.degrees(np.unwrap(np.angle(g)))
    upper.fill_between(
        omega, np.abs(g) * np.exp(-1.96 * std[0]), np.abs(g) * np.exp(1.96 * std[0]), color=MODEL, alpha=0.22, lw=0
    )
    wide = np.degrees(1.96 * std[1])
    lower.fill_between(omega, phase - wide, phase + wide, color=MODEL, alpha=0.22, lw=0)
    if run.truth is not None and linear_blocks(run.truth, side):
        truth = gain(run.truth, linear_blocks(run.truth, side), omega)
        _curves(upper, lower, omega, truth, color=TRUTH, ls="--", lw=1.1, label="truth")
    if points is not None:
        style = {"fmt": "o", "color": MEASURED, "mfc": "white", "capsize": 2, "elinewidth": 1, "zorder": 3}
        upper.errorbar(points["omega"], points["gain"], 1.96 * points["gain_std"], **style, label="at the sines")
        near = np.interp(points["omega"], omega, phase)
        turned = np.degrees(points["phase"]) + 360 * np.round((near - np.degrees(points["phase"])) / 360)
        lower.errorbar(points["omega"], turned, np.degrees(1.96 * points["phase_std"]), **style)
    upper.set_xscale("log")
    upper.set_yscale("log")
    _ticks(upper)
    lower.set_xlabel("frequency, rad/s")


def _curves(upper: Axes, lower: Axes, omega: Floats, g: Any, **style: Any) -> None:
    upper.plot(omega, np.abs(g), **style)
    lower.plot(omega, np.degrees(np.unwrap(np.angle(g))), **style)


def _ticks(axes: Axes) -> None:
    """Write plain numbers, and at 1, 2, 5 where less than two decades are shown."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 100 else (1.0,)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _points(run: Any, side: str) -> dict[str, Floats] | None:
    stage = run.stages.get(POINTS)
    if stage is None or not len(getattr(stage, f"{side}_omega", ())):
        return None
    names = ("omega", "gain", "gain_std", "phase", "phase_std")
    return {name: np.nan_to_num(np.asarray(getattr(stage, f"{side}_{name}"), float), posinf=0.0) for name in names}


def _frequencies(system: Any, places: list[int], points: dict[str, Floats] | None, dt: float) -> Floats:
    """Return a grid that spans the corners and the measured points, below half the sampling rate."""
    corners = [abs(p) for place in places for p in _corners(system.chain[place])] + list(points["omega"] if points else ())
    nyquist = np.pi / dt
    corners = [c for c in corners if 0 < c < np.inf] or [nyquist / 10]
    low, high = min(corners) / 10, min(max(corners) * 10, nyquist)
    return np.geomspace(min(low, high / 100), high, 300)


def _corners(block: Any) -> Floats:
    """Return the moduli of the poles in rad/s."""
    poles = np.roots(block.transfer_function()[1]) if hasattr(block, "transfer_function") else np.empty(0)
    step = getattr(block, "dt", None)
    return np.abs(poles if step is None else np.log(poles[poles != 0].astype(complex)) / step)
