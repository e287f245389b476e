"""Smooth static curve through many points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import MinLen

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats, Ints


@dataclass(frozen=True, kw_only=True)
class Spline(Static):
    """Natural cubic spline through given points, straight beyond them: a smooth curve with many numbers.

    w = A·outputs[k] + B·outputs[k+1] + ((A³ − A)·c[k] + (B³ − B)·c[k+1])·h²/6 on [inputs[k], inputs[k+1]],
    B = (v − inputs[k])/h, A = 1 − B, c = w″ at the inputs (linear in the outputs, 0 at both ends)

          w        ╭──●───
          │     ●─╯
    ──────┼───╭╯───────► v
       ───●──╯

    inputs ascending, at least two, input units (they stay as they are in a fit); outputs free. Raises
    `WhidError("block-parameters")` for unequal lengths or inputs that do not ascend.
    Source [Press et al. 2007, Numerical Recipes], section 3.3.

    >>> Spline(inputs=(0.0, 1.0, 2.0), outputs=(0.0, 1.0, 0.0))([0.0, 0.5, 1.0, 3.0], dt=1.0)
    array([ 0.    ,  0.6875,  1.    , -1.5   ])
    """

    inputs: Annotated[tuple[float, ...], MinLen(2)]
    outputs: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(2)]

    def __post_init__(self) -> None:
        if len(self.inputs) != len(self.outputs) or len(self.inputs) < 2:
            raise WhidError(
                "block-parameters",
                f"spline needs as many outputs as inputs, two or more: {len(self.inputs)}, {len(self.outputs)}",
            )
        if any(b >= a for b, a in zip(self.inputs, self.inputs[1:], strict=False)):
            raise WhidError("block-parameters", f"spline inputs must ascend: {list(self.inputs)}")

    def value(self, v: Floats) -> Floats:
        """Return the spline, straight beyond its ends."""
        return self.value_and_slope(v)[0]

    def derivative(self, v: Floats) -> Floats:
        """Return the slope, that of the ends beyond them."""
        return self.value_and_slope(v)[1]

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the cardinal spline of the point: 1 there, 0 at all others."""
        outputs = np.zeros(len(self.outputs))
        outputs[int(name.partition(".")[2])] = 1.0
        return _evaluate(self.inputs, outputs, v)[0]

    def sensitivities(self, v: Floats, names: Sequence[str], out: Floats) -> None:
        """Write the cardinal splines, all found in one pass."""
        points = [int(name.partition(".")[2]) for name in names]
        out[...] = self.basis(v.ravel()).T[points].reshape(out.shape)

    def value_and_slope(self, v: Floats) -> tuple[Floats, Floats]:
        """Return f(v) and f′(v), any shape, in one pass."""
        return _evaluate(self.inputs, np.array(self.outputs, float), v)

    def basis(self, v: Floats) -> Floats:
        """Return every point's cardinal spline at v (N,): (N, K), so that f = basis @ outputs."""
        bend, (low, high) = curvature(self.inputs), _end_slopes(self.inputs)
        c = _cell(self.inputs, v)
        design, place = np.zeros((len(v), len(self.inputs))), np.arange(len(v)) * len(self.inputs) + c.k
        flat = design.reshape(-1)
        flat[place], flat[place + 1] = (c.a**3 - c.a) * c.h**2 / 6, (c.b**3 - c.b) * c.h**2 / 6
        design = design @ bend
        flat = design.reshape(-1)
        flat[place] += c.a
        flat[place + 1] += c.b
        for side, slope in ((c.beyond < 0, low), (c.beyond > 0, high)):
            design[side] += c.beyond[side, None] * slope
        return design


class _Cell(NamedTuple):
    k: Ints
    h: Floats
    a: Floats
    b: Floats
    beyond: Floats  # how far v lies beyond the ends


@lru_cache(maxsize=64)
def curvature(inputs: tuple[float, ...]) -> Floats:
    """Return M (K, K): w″ at the points = M @ outputs, 0 at both ends.

    >>> curvature((0.0, 1.0, 2.0)).tolist()
    [[0.0, 0.0, 0.0], [1.5, -3.0, 1.5], [0.0, 0.0, 0.0]]
    """
    h, count = np.diff(inputs), len(inputs)
    bend, load = np.eye(count), np.zeros((count, count))
    for k in range(1, count - 1):
        bend[k, k - 1 : k + 2] = h[k - 1] / 6, (h[k - 1] + h[k]) / 3, h[k] / 6
        load[k, k - 1 : k + 2] = 1 / h[k - 1], -1 / h[k - 1] - 1 / h[k], 1 / h[k]
    return np.asarray(np.linalg.solve(bend, load))


def _end_slopes(inputs: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return rows (K,): the slope at the first and at the last point = row @ outputs."""
    bend, h, one = curvature(inputs), np.diff(inputs), np.eye(len(inputs))
    return (one[1] - one[0]) / h[0] - h[0] / 6 * bend[1], (one[-1] - one[-2]) / h[-1] + h[-1] / 6 * bend[-2]


def _cell(inputs: tuple[float, ...], v: Floats) -> _Cell:
    x = np.array(inputs)
    inside = np.clip(v, x[0], x[-1])
    k = np.searchsorted(x[1:-1], inside, side="right")
    h = np.diff(x)[k]
    b = (inside - x[k]) / h
    return _Cell(k, h, 1 - b, b, np.asarray(v - inside))


def _evaluate(inputs: tuple[float, ...], outputs: Floats, v: Floats) -> tuple[Floats, Floats]:
    bend, c = curvature(inputs) @ outputs, _cell(inputs, np.asarray(v, float))
    left, right, rise = bend[c.k], bend[c.k + 1], np.diff(outputs)[c.k]
    slope = rise / c.h + ((1 - 3 * c.a**2) * left + (3 * c.b**2 - 1) * right) * c.h / 6
    value = outputs[c.k] + rise * c.b + ((c.a**3 - c.a) * left + (c.b**3 - c.b) * right) * c.h**2 / 6
    return value + c.beyond * slope, slope
