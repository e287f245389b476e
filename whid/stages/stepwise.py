"""The paper's own estimate: f from the levels, |G_front| from the mean of the output, |G_back| from its harmonics."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from whid.fit import linear_least_squares
from whid.quantity import Measured, Quantity, Table
from whid.stages._inner_harmonics import inner_harmonics
from whid.stages._responses import Responses, StaticPart

Floats = NDArray[np.float64]


class Stepwise(NamedTuple):
    """Gains one after another; a phase needs a gauge and comes with the joint estimate.

    front_gain at omega; back_gain[e, k] at harmonic order[k]·omega[e], NaN where there is no harmonic.
    """

    omega: Annotated[Floats, Quantity("rad/s", dims=("omega",))]
    order: Annotated[NDArray[np.intp], Quantity(dims=("order",))]
    front_gain: Annotated[Floats, Quantity(dims=("omega",), error="front_gain_std")]
    front_gain_std: Annotated[Floats, Quantity(dims=("omega",))]
    back_gain: Annotated[Floats, Quantity(dims=("omega", "order"), error="back_gain_std")]
    back_gain_std: Annotated[Floats, Quantity(dims=("omega", "order"))]
    coefficients: Annotated[Floats, Quantity("output", dims=("power",), error="coefficients_std")]
    coefficients_std: Annotated[Floats, Quantity("output", dims=("power",))]

    def table(self) -> Table:
        """Return one row a sine."""
        columns = ("ω, rad/s", "|G_front(jω)|", *(f"|G_back(j{k}ω)|" for k in self.order))
        rows = []
        for e, w in enumerate(self.omega):
            backs = [
                Measured(float(g), float(s)) if np.isfinite(g) else None
                for g, s in zip(self.back_gain[e], self.back_gain_std[e], strict=True)
            ]
            front = self.front_gain[e]
            rows.append(
                (float(w), Measured(float(front), float(self.front_gain_std[e])) if np.isfinite(front) else None, *backs)
            )
        blank = (
            "blank: not to be had step by step; |G_front| needs a piece of degree 2, where it moves the mean of the output"
        )
        return Table("Stepwise estimate (as in the paper)", columns, tuple(rows), (blank,) if None in sum(rows, ()) else ())

    def metrics(self) -> dict[str, Measured]:
        """Return every gain by name, `paper.front.gain@0.02`."""
        found: dict[str, Measured] = {}
        for e in np.flatnonzero(np.isfinite(self.front_gain)):
            w = self.omega[e]
            found[f"paper.front.gain@{w:.6g}"] = Measured(float(self.front_gain[e]), float(self.front_gain_std[e]))
        for k, (column, errors) in enumerate(zip(self.back_gain.T, self.back_gain_std.T, strict=True), 1):
            for w, g, s in zip(self.omega, column, errors, strict=True):
                if np.isfinite(g):  # where two sines reach one frequency, the lower harmonic is the better estimate
                    found.setdefault(f"paper.back.gain@{k * w:.6g}", Measured(float(g), float(s)))
        return found


def stepwise(static: StaticPart, responses: Responses, degree: int | None = None) -> Stepwise:
    """Estimate |G_front(jω)| and |G_back(jkω)| step by step from levels and harmonics of sines on one polynomial piece.

    1. f = Σ cₚ vᵖ by least squares on the levels of the piece (degree: that found, or as given).
    2. g = |x| solves A₀(g) = H₀; |G_front| = g/|phasor|.
    3. |G_back(jkω)| = |H_k|/|A_k(g)|.
    Standard errors by the delta method over levels and harmonics. NaN where a step has no real solution.
    Source [Brouri2019], eqs. (3.13), (3.24), (4.4b), (4.5).
    """
    piece = int(np.searchsorted(static.breaks, responses.offset[0]))
    on_piece = np.searchsorted(static.breaks, static.level, side="right") == piece
    degree = static.degrees[piece] if degree is None else degree
    design = static.level[on_piece, None] ** np.arange(degree + 1)
    f = linear_least_squares(design, static.mean[on_piece], 1 / static.mean_std[on_piece])
    orders = [[k for k in ks if k <= degree] for ks in responses.orders]
    count = max(max(ks) for ks in orders)
    shape = (len(responses.omega), count)
    front, front_std = np.full(shape[0], np.nan), np.full(shape[0], np.nan)
    back, back_std = np.full(shape, np.nan), np.full(shape, np.nan)
    no_breaks = np.empty(0)
    for e, ks in enumerate(orders):
        inner = _inner_gain(f.values, float(responses.offset[e]), abs(responses.phasor[e]), responses.value[e, 0].real)
        if inner is None:
            continue
        a = inner_harmonics(no_breaks, f.values[None, :], responses.offset[[e]], np.array([inner]), max(ks))
        value, by_f, by_g = a.value[0], a.by_coefficient[0, :, 0, :], a.by_amplitude[0]
        # dg = (dH₀ − A₀,c dc)/A₀,g : the gain's derivative with respect to (H₀, c)
        dg = np.concatenate([[1.0], -by_f[0]]) / by_g[0]
        covariance = np.zeros((degree + 2, degree + 2))
        covariance[0, 0], covariance[1:, 1:] = responses.value_std[e, 0] ** 2, f.covariance
        front[e] = inner / abs(responses.phasor[e])
        front_std[e] = np.sqrt(dg @ covariance @ dg) / abs(responses.phasor[e])
        for k in ks:
            if k:
                size = abs(responses.value[e, k])
                back[e, k - 1] = size / abs(value[k])
                dlog = -(np.concatenate([[0.0], by_f[k]]) + by_g[k] * dg) / value[k]
                own = (responses.value_std[e, k] / size) ** 2
                back_std[e, k - 1] = back[e, k - 1] * np.sqrt(own + dlog @ covariance @ dlog)
    return Stepwise(responses.omega, np.arange(1, count + 1), front, front_std, back, back_std, f.values, f.std)


def _inner_gain(coefficients: Floats, offset: float, reach: float, mean: float) -> float | None:
    """Solve A₀(g) = mean for g: A₀ is a polynomial in g²; the root nearest to the input's amplitude counts.

    A₀(g) = Σ_j f⁽²ʲ⁾(offset)/(2ʲ j!)² g²ʲ, the mean of f over a cosine.
    """
    from math import factorial

    even = range((len(coefficients) + 1) // 2)
    series = [poly.polyval(offset, poly.polyder(coefficients, 2 * j)) / (2**j * factorial(j)) ** 2 for j in even]
    series[0] -= mean
    series = np.trim_zeros(series, "b")
    roots = poly.polyroots(series) if len(series) > 1 else np.empty(0)
    squares = [r.real for r in roots if abs(r.imag) < 1e-9 * (1 + abs(r)) and r.real > 0]
    return min((np.sqrt(s) for s in squares), key=lambda g: abs(g - reach), default=None)
