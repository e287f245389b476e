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


def model_of(fit: AffineFit, estimate: Estimate, pieces: InputPieces, linear: TransferFunction) -> Model:
    """Return h, G (and a delay), f with f(0) = 0 and the covariance of their numbers.

    x is shifted by the root of f nearest to the middle of the anchor; without one where the data are it stays, and f(0) is a
    number.
    The covariance of h and f is carried over from the joint fit, that of G stands beside it.
    """
    system, names, values = _assembled(fit, pieces, linear)
    count = len(estimate.values)

    def numbers(theta: Floats) -> Floats:
        return _assembled(fit.standing(theta), pieces, linear)[2]

    own = _carried(numbers, fit, estimate, count)
    tf = linear.estimate
    places = [names.index(_linear_name(name, linear)) for name in tf.names]
    own[places, :] = own[:, places] = 0.0
    own[np.ix_(places, places)] = tf.covariance
    std = np.sqrt(np.maximum(np.diag(own), 0.0))
    jumps = [k for k in range(len(pieces.breaks)) if pieces.jump[k]]
    for k in jumps:
        place = names.index(f"chain.0.breaks.{k}")
        own[place, :] = own[:, place] = 0.0
        own[place, place] = pieces.break_std[k] ** 2
        std[place] = pieces.break_std[k]
    whole = estimate._replace(
        names=tuple(names),
        values=values,
        covariance=own,
        std=std,
        rank=len(names),
        null_directions=np.empty((0, len(names))),
    )
    return Model(system, whole, "unit_dc")


def held_names(system: System, anchor: int) -> tuple[str, ...]:
    """Return the numbers that are conventions: unit static gain, unit slope of the anchor, f(0) = 0 (or x = 0 there)."""
    linear, f = system.chain[1], system.chain[-1]
    assert isinstance(linear, Linear)
    assert isinstance(f, Polynomial)
    last = len(system.chain) - 1
    shift = f"chain.{last}.coefficients.0" if f.coefficients[0] == 0 else f"chain.0.pieces.{anchor}.0"
    return (
        f"chain.1.num.{len(linear.num or ()) - 1}",
        f"chain.1.den.{len(linear.den or ()) - 1}",
        f"chain.0.pieces.{anchor}.1",
        shift,
    )


def shift_of(fit: AffineFit) -> float | None:
    """Return the root of f nearest to the middle of the anchor, None where f has none within twice the reach of the data."""
    x = np.array([fit.pieces[p].at(u) for p, u in zip(fit.levels.piece, fit.levels.level, strict=True)])
    real = real_roots(fit.coefficients)
    near = real[(real > x.min() - np.ptp(x)) & (real < x.max() + np.ptp(x))]
    return float(near[np.argmin(np.abs(near))]) if len(near) else None


def _assembled(fit: AffineFit, pieces: InputPieces, linear: TransferFunction) -> tuple[System, list[str], Floats]:
    root = shift_of(fit)
    x0 = root or 0.0
    f = shifted(fit.coefficients, x0)
    if root is not None:
        f[0] = 0.0
    lines = [fit.pieces[k] for k in range(len(pieces.centre))]
    breaks = [
        float(b) if pieces.jump[k] else _meeting(lines[k], lines[k + 1], float(b)) for k, b in enumerate(pieces.breaks)
    ]
    powers = tuple(
        (p.value - x0,) if p.flat else (p.value - p.slope * p.centre - x0, p.slope) for p in lines
    )  # fmt: skip
    h = Piecewise(breaks=tuple(breaks), pieces=powers)
    g = Linear(num=tuple(map(float, linear.num)), den=tuple(map(float, linear.den)))
    late: tuple[Block, ...] = (Delay(seconds=linear.delay),) if "delay" in linear.estimate.names else ()
    system = System(chain=(h, g, *late, Polynomial(coefficients=tuple(map(float, f)))))
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


def _carried(numbers: Callable[[Floats], Floats], fit: AffineFit, estimate: Estimate, count: int) -> Floats:
    """Return the covariance of numbers(θ) by differences of a small part of a standard error."""
    theta = np.array([p.value for p in fit.parameters])
    steps = STEP * np.where(np.isfinite(estimate.std) & (estimate.std > 0), estimate.std, 1e-6)
    rates = np.column_stack(
        [(numbers(theta + d) - numbers(theta - d)) / (2 * s) for d, s in zip(np.diag(steps), steps, strict=True)]
    )
    return np.asarray(rates @ estimate.covariance @ rates.T)
