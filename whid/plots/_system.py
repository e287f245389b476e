"""What pictures ask of a system: its linear blocks before and after the nonlinearity, its static curve, bands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def linear_blocks(system: Any, side: str) -> list[int]:
    """Return the places in the chain of the linear blocks front of, back from or between the nonlinear ones.

    side: front, between or back. A system without nonlinear blocks is all front.
    """
    linear = [hasattr(block, "gain_at") for block in system.series]
    if all(linear):
        return list(range(len(linear))) if side == "front" else []
    first, last = linear.index(False), len(linear) - 1 - linear[::-1].index(False)
    places = {"front": range(first), "between": range(first, last), "back": range(last + 1, len(linear))}[side]
    return [k for k in places if linear[k]]


def static_groups(system: Any) -> list[list[Any]]:
    """Return the static blocks in order, those without a block between them together."""
    groups: list[list[Any]] = [[]]
    for block in system.series:
        if hasattr(block, "sensitivity"):
            groups[-1].append(block)
        elif groups[-1]:
            groups.append([])
    return [group for group in groups if group]


def gain(system: Any, places: list[int], omega: Floats) -> Complexes:
    """Return G(jω)/G(0) of linear blocks in series: what does not depend on how the static gain is shared out."""
    g, dc = np.ones(len(omega), complex), 1.0 + 0.0j
    with np.errstate(all="ignore"):
        for place in places:
            g = g * system.series[place].gain_at(omega)
            dc = dc * complex(system.series[place].gain_at(np.zeros(1))[0])
    return g / dc if np.isfinite(dc) and dc != 0 else g


def gain_and_band(model: Any, places: list[int], omega: Floats) -> tuple[Complexes, Floats]:
    """Return G(jω)/G(0) of a model and the standard error of its logarithm: of log gain (real), of phase (imaginary)."""

    def log_gain(values: Floats) -> Complexes:
        changed = dict(zip(np.asarray(names)[mine], values, strict=True))
        chain = tree.with_parameters({str(name): float(value) for name, value in changed.items()}).chain
        return np.log(gain(replace(model.system, chain=chain), places, omega))

    names, tree = model.estimate.names, model.system.tree
    mine = [
        j for j, name in enumerate(names) if any(name.startswith(f"{model.system.series_path}{place}.") for place in places)
    ]
    covariance = np.asarray(model.estimate.covariance)[np.ix_(mine, mine)]
    nominal = gain(model.system, places, omega)
    if not mine or not np.all(np.isfinite(covariance)):
        return nominal, np.full((2, len(omega)), np.nan)
    slopes = _slopes(log_gain, np.asarray(model.estimate.values, float)[mine], np.sqrt(np.diag(covariance)))
    variance = [np.einsum("pw,pq,qw->w", part, covariance, part) for part in (slopes.real, slopes.imag)]
    return nominal, np.sqrt(np.maximum(variance, 0.0))


def _slopes(function: Callable[[Floats], Complexes], at: Floats, std: Floats) -> Complexes:
    """Return the derivatives (p, ω) by five-point differences: one number alone turns slow poles far within its error."""
    steps = np.where(std > 0, 1e-3 * std, 1e-6 * np.maximum(np.abs(at), 1e-6))
    return np.array(
        [
            (8 * (function(at + d) - function(at - d)) - (function(at + 2 * d) - function(at - 2 * d))) / (12 * h)
            for d, h in zip(np.diag(steps), steps, strict=True)
        ]
    )


def jump_levels(system: Any) -> Floats:
    """Return the input levels at which the steady output of linear, static and linear blocks in series jumps."""
    places = [place for place, block in enumerate(system.series) if hasattr(block, "jumps") and np.any(block.jumps())]
    if len(places) != 1:
        return np.empty(0)
    block, front = system.series[places[0]], system.series[: places[0]]
    static = np.prod([complex(b.gain_at(np.zeros(1))[0]).real for b in front if hasattr(b, "gain_at")])
    return np.asarray(block.breakpoints()[np.asarray(block.jumps()) != 0] / static)


def steady_curve(system: Any, levels: Floats, dt: float) -> Floats:
    """Return the output level of every constant input, NaN where there is none."""
    out = np.full(len(levels), np.nan)
    for k, level in enumerate(levels):
        try:
            out[k] = system.tree.steady(float(level), dt)[0]
        except Exception:
            continue
    return out
