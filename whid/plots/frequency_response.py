"""Gain and phase of the linear blocks in front of, between and behind the nonlinear ones, with bands and measured points."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whid.plots._style import MEASURED, MODEL, TRUTH, Floats, log_ticks, spaced
from whid.plots._system import gain, gain_and_band, linear_blocks

NEEDS = ("model", "linear")
POINTS = "joint"  # the stage with the responses at the measured frequencies


def draw(run: Any, figure: Figure) -> None:
    """Draw a column a side that has linear blocks: gain and phase, below each what differs from the model."""
    model = run.stages["model"]
    sides = [side for side in ("front", "between", "back") if _moves(model.system, side)]
    if not sides:
        figure.text(0.5, 0.5, "the model has no linear dynamics", ha="center")
        return
    figure.set_size_inches(0.6 + 3.7 * max(len(sides), 1.5), 6.8)
    axes = figure.subplots(4, len(sides), sharex="col", squeeze=False, height_ratios=(2.2, 1, 2.2, 1))
    for column, side in zip(axes.T, sides, strict=True):
        _side(column, run, side)
        column[0].set_title("Block between" if side == "between" else f"{side.capitalize()} block")
        column[-1].set_xlabel("frequency, rad/s")
    for ax, text in zip(axes[:, 0], ("gain / static gain", "Δ gain, %", "phase, °", "Δ phase, °"), strict=True):
        ax.set_ylabel(text)
    axes[0, 0].legend(loc="lower left")
    spaced(figure, 4, len(sides), (0.65, 0.12))


def _moves(system: Any, side: str) -> bool:
    """Tell whether a side has a block with poles, zeros or a delay: a gain alone is no picture."""
    blocks = [system.series[place] for place in linear_blocks(system, side)]
    plain = [hasattr(b, "transfer_function") and max(map(len, b.transfer_function())) == 1 for b in blocks]
    return not all(plain)


def _side(axes: Any, run: Any, side: str) -> None:
    model, points = run.stages["model"], _points(run, side)
    places = linear_blocks(model.system, side)
    omega = _frequencies(model.system, places, points, run.records[0].dt)
    response, std = gain_and_band(model, places, omega)
    _pair(axes[:2], omega, np.abs(response), std[0], relative=True)
    _pair(axes[2:], omega, np.degrees(np.unwrap(np.angle(response))), np.degrees(std[1]))
    if run.truth is not None and linear_blocks(run.truth, side):
        ratio = gain(run.truth, linear_blocks(run.truth, side), omega) / response
        style = {"color": TRUTH, "ls": "--", "lw": 1.1, "label": "truth"}
        axes[0].plot(omega, np.abs(response * ratio), **style)
        axes[1].plot(omega, 100 * (np.abs(ratio) - 1), **style)
        axes[2].plot(omega, np.degrees(np.unwrap(np.angle(response)) + np.angle(ratio)), **style)
        axes[3].plot(omega, np.degrees(np.angle(ratio)), **style)
    if points is not None:
        _measured(axes, points, gain(model.system, places, points["omega"]), np.unwrap(np.angle(response)), omega)
    for ax, band, scale in ((axes[1], std[0], 100.0), (axes[3], std[1], np.degrees(1.0))):
        _zoom(ax, omega, scale * band, points)
    axes[0].set_xscale("log")
    axes[0].set_yscale("log")
    shown, turned = np.abs(response), np.degrees(np.unwrap(np.angle(response)))
    _within(axes[0], shown.min() / 3, shown.max() * 3)
    _within(axes[2], turned.min() - 60, turned.max() + 60)
    _within(axes[1], -100, 100)
    _within(axes[3], -90, 90)
    for axis in (axes[0].xaxis, axes[0].yaxis):
        log_ticks(axis)


def _within(axes: Axes, low: float, high: float) -> None:
    """Cut an axis to where there is something to see: the band of what is not determined at all has no end."""
    now = axes.get_ylim()
    axes.set_ylim(max(now[0], low), min(now[1], high))


def _pair(axes: Any, omega: Floats, value: Floats, std: Floats, relative: bool = False) -> None:
    """Draw a curve with its 95 % band, and the band alone below."""
    half = 1.96 * std
    low, high = (value * np.exp(-half), value * np.exp(half)) if relative else (value - half, value + half)
    axes[0].fill_between(omega, low, high, color=MODEL, alpha=0.22, lw=0)
    axes[0].plot(omega, value, color=MODEL, label="model, 95 % band")
    half = 100 * half if relative else half
    axes[1].fill_between(omega, -half, half, color=MODEL, alpha=0.22, lw=0)
    axes[1].axhline(0, color=MODEL, lw=1)


def _measured(axes: Any, points: dict[str, Floats], model: Any, phase: Floats, omega: Floats) -> None:
    style: dict[str, Any] = {
        "fmt": "o", "color": MEASURED, "mfc": "white", "capsize": 2, "elinewidth": 1, "zorder": 3, "label": "at the sines",
    }  # fmt: skip
    w, gain_error = points["omega"], 1.96 * points["gain_std"]
    turned = np.angle(np.exp(1j * points["phase"]) / model)  # measured less model, no whole turns
    phase_error = np.degrees(1.96 * points["phase_std"])
    axes[0].errorbar(w, points["gain"], gain_error, **style)
    axes[1].errorbar(w, 100 * (points["gain"] / np.abs(model) - 1), 100 * gain_error / np.abs(model), **style)
    axes[2].errorbar(w, np.degrees(np.interp(w, omega, phase) + turned), phase_error, **style)
    axes[3].errorbar(w, np.degrees(turned), phase_error, **style)


def _zoom(ax: Axes, omega: Floats, std: Floats, points: dict[str, Floats] | None) -> None:
    """Show the differences where something was measured; further out the band may leave the picture."""
    inside = omega <= 2 * points["omega"].max() if points else np.ones(len(omega), bool)
    widest = 1.96 * np.nanmax(std[inside], initial=0.0)
    for line in ax.containers:
        widest = max([widest, *(np.abs(s).max() for bars in line[2] for s in (np.array(bars.get_segments())[..., 1],))])
    if np.isfinite(widest) and widest > 0:
        ax.set_ylim(-1.3 * widest, 1.3 * widest)


def _points(run: Any, side: str) -> dict[str, Floats] | None:
    stage = run.stages.get(POINTS)
    if stage is None or not len(getattr(stage, f"{side}_omega", ())):
        return None
    names = ("omega", "gain", "gain_std", "phase", "phase_std")
    return {name: np.nan_to_num(np.asarray(getattr(stage, f"{side}_{name}"), float), posinf=0.0) for name in names}


def _frequencies(system: Any, places: list[int], points: dict[str, Floats] | None, dt: float) -> Floats:
    """Return a grid that spans the corners and the measured points, below half the sampling rate."""
    corners = [abs(p) for place in places for p in _corners(system.series[place])] + list(points["omega"] if points else ())
    nyquist = np.pi / dt
    corners = [c for c in corners if 0 < c < np.inf] or [nyquist / 10]
    low, high = min(corners) / 10, min(max(corners) * 10, nyquist)
    return np.geomspace(min(low, high / 100), high, 300)


def _corners(block: Any) -> Floats:
    """Return the moduli of the poles in rad/s."""
    poles = np.roots(block.transfer_function()[1]) if hasattr(block, "transfer_function") else np.empty(0)
    step = getattr(block, "dt", None)
    return np.abs(poles if step is None else np.log(poles[poles != 0].astype(complex)) / step)
