"""Affine pieces, a transfer function and a polynomial put together as a Model: the one shift, at the end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from whid.blocks._block import Block
from whid.blocks.delay import Delay
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.blocks.polynomial import Polynomial
from whid.fit import Estimate
from whid.methods._method import Model
from whid.signal import Floats
from whid.stages._affine_fit import Affine, AffineFit, real_roots, shifted
from whid.stages.input_pieces import InputPieces
from whid.stages.transfer_function import TransferFunction
from whid.system import System

STEP = 1e-5  # of a standard error: the difference that carries a covariance over


def model_of(pieces: InputPieces, fit: AffineFit, linear: TransferFunction, plain: bool = False) -> Model:
    """Return h, G (and a delay), f with f(0) = 0 and the covariance of their numbers.

    x is shifted by the root of f nearest to the middle of the anchor; without one where the data are it stays, and f(0) is a
    number. plain: f is a straight line, goes into h, and is left out.
    The covariance of h and f is carried over from the joint fit, that of G stands beside it.
    """
    estimate = pieces.estimate
    system, names, values = _assembled(fit, pieces, linear, plain)

    def numbers(theta: Floats) -> Floats:
        return _assembled(fit.standing(theta), pieces, linear, plain)[2]

    covariance = _carried(numbers, fit, estimate)
    places = [names.index(_linear_name(name, linear)) for name in linear.estimate.names]
    covariance[places, :] = covariance[:, places] = 0.0
    covariance[np.ix_(places, places)] = linear.estimate.covariance
    for k in np.flatnonzero(pieces.jump):
        place = names.index(f"chain.0.breaks.{k}")
        covariance[place, :] = covariance[:, place] = 0.0
        covariance[place, place] = pieces.break_std[k] ** 2
    found = estimate._replace(
        names=tuple(names), values=values, covariance=covariance, std=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        rank=len(names), null_directions=np.empty((0, len(names))),
    )  # fmt: skip
    return Model(system, found, "unit_dc")


def held_names(system: System, anchor: int) -> tuple[str, ...]:
    """Return the numbers that are conventions: unit static gain; with an f also unit slope of the anchor and f(0) = 0.

    Where f does not vanish near the data, x = 0 at the middle of the anchor is held instead.
    """
    linear, f = system.chain[1], system.chain[-1]
    assert isinstance(linear, Linear)
    unit = (f"chain.1.num.{len(linear.num or ()) - 1}", f"chain.1.den.{len(linear.den or ()) - 1}")
    if not isinstance(f, Polynomial):
        return unit
    at = f"chain.{len(system.chain) - 1}.coefficients.0" if f.coefficients[0] == 0 else f"chain.0.pieces.{anchor}.0"
    return (*unit, f"chain.0.pieces.{anchor}.1", at)


def shift_of(fit: AffineFit) -> float | None:
    """Return the root of f nearest to the middle of the anchor, None where f has none within twice the reach of the data."""
    x = np.array([fit.pieces[p].at(u) for p, u in zip(fit.levels.piece, fit.levels.level, strict=True)])
    real = real_roots(fit.coefficients)
    near = real[(real > x.min() - np.ptp(x)) & (real < x.max() + np.ptp(x))]
    return float(near[np.argmin(np.abs(near))]) if len(near) else None


def _assembled(
    fit: AffineFit, pieces: InputPieces, linear: TransferFunction, plain: bool
) -> tuple[System, list[str], Floats]:
    """Return the system, the names of its numbers that are no conventions, and their values."""
    root = None if plain else shift_of(fit)
    f = shifted(fit.coefficients, root or 0.0)
    if root is not None:
        f[0] = 0.0
    add, times = (fit.coefficients[0], fit.coefficients[1]) if plain else (-(root or 0.0), 1.0)
    lines = [fit.pieces[k] for k in range(len(pieces.centre))]
    breaks = [
        float(b) if pieces.jump[k] else _meeting(lines[k], lines[k + 1], float(b)) for k, b in enumerate(pieces.breaks)
    ]
    powers = [(add + times * p.at(0.0), *(() if p.flat else (times * p.slope,))) for p in lines]
    h = Piecewise(breaks=tuple(breaks), pieces=tuple(tuple(map(float, piece)) for piece in powers))
    g = Linear(num=tuple(map(float, linear.num)), den=tuple(map(float, linear.den)))
    late: tuple[Block, ...] = (Delay(seconds=linear.delay),) if "delay" in linear.estimate.names else ()
    last = () if plain else (Polynomial(coefficients=tuple(map(float, f))),)
    system = System(chain=(h, g, *late, *last))
    held = held_names(system, pieces.anchor)
    free = {p.name: p.value for p in system.tree.parameters(held=True) if p.name not in held}
    return system, list(free), np.array(list(free.values()))


def _meeting(a: Affine, b: Affine, near: float) -> float:
    rate = b.slope - a.slope
    return a.centre - (b.at(a.centre) - a.value) / rate if rate else near


def _linear_name(name: str, linear: TransferFunction) -> str:
    if name == "delay":
        return "chain.2.seconds"
    part, power = name.split(".")
    return f"chain.1.{part}.{len(getattr(linear, part)) - 1 - int(power)}"


def _carried(numbers: Callable[[Floats], Floats], fit: AffineFit, estimate: Estimate) -> Floats:
    """Return the covariance of numbers(θ) by differences of a small part of a standard error."""
    theta = np.array([p.value for p in fit.parameters])
    steps = STEP * np.where(np.isfinite(estimate.std) & (estimate.std > 0), estimate.std, 1e-6)
    rates = np.column_stack(
        [(numbers(theta + d) - numbers(theta - d)) / (2 * s) for d, s in zip(np.diag(steps), steps, strict=True)]
    )
    return np.asarray(rates @ estimate.covariance @ rates.T)
