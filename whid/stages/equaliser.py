"""The inverse of a memoryless curve: what undoes it."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from whid.blocks.chain import Chain
from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.errors import WhidError
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats, rms
from whid.stages._chebyshev import Domain, basis, evaluate, nodes, scaled, transform, unscaled
from whid.stages.curve_estimates import CurveEstimates
from whid.stages.node_windows import NodeWindows

HALVINGS = 60  # of a bracket, to rounding
FLAT = 1e-9  # of the mean slope: what counts as none


class Equaliser(NamedTuple):
    """Equaliser: the output clamped to the range that the curve covers, then its inverse as a Chebyshev polynomial."""

    node: Annotated[Floats, Quantity("output", ("node",))]
    value: Annotated[Floats, Quantity("input", ("node",), error="value_std")]
    value_std: Annotated[Floats, Quantity("input", ("node",))]
    coefficients: Annotated[Floats, Quantity("input", ("order",), error="std")]
    std: Annotated[Floats, Quantity("input", ("order",))]
    covariance: Annotated[Floats, Quantity("input²", ("order", "order"))]
    domain: Annotated[tuple[float, float], Quantity("output")]
    error_db: float  # of the cascade without noise over the data's inputs: inversion and standard error, re rms input
    regressed: Annotated[Floats, Quantity("input", ("order",))]  # as in the paper: input over noisy output; NaN if refused
    regressed_error_db: float
    regressed_refused: str

    @property
    def tree(self) -> Chain:
        """Return clamp and polynomial as a block that simulates."""
        low, high = map(float, self.domain)
        clamp = Saturation(low=low, high=high, fix=True)
        inverse = Polynomial(coefficients=tuple(map(float, self.coefficients)), basis="chebyshev", domain=(low, high))
        return Chain(chain=(clamp, inverse))

    def table(self) -> Table:
        """Return the coefficients, ours and the paper's."""
        rows = tuple(
            (f"C{j}", Measured(float(c), float(s)), float(r))
            for j, (c, s, r) in enumerate(zip(self.coefficients, self.std, self.regressed, strict=True))
        )
        low, high = self.domain
        notes = [
            f"output clamped to [{low:.6g}, {high:.6g}]: beyond, the inverse is not known",
            f"error of curve and equaliser in cascade, no noise: {self.error_db:.1f} dB of the input's rms (predicted)",
        ]
        notes += [f"as in the paper, the input regressed on the noisy output: {self.regressed_error_db:.1f} dB"] * bool(
            not self.regressed_refused
        )
        notes += [f"as in the paper: refused, {self.regressed_refused}"] * bool(self.regressed_refused)
        columns = ("coefficient, input", "inverse of the fit", "as in the paper")
        return Table("Equaliser", columns, rows, tuple(notes))

    def metrics(self) -> dict[str, float | Measured]:
        """Return the errors of the cascade, dB re the input's rms."""
        found: dict[str, float | Measured] = {"equaliser.error_db": self.error_db}
        return found | ({} if self.regressed_refused else {"paper.equaliser.error_db": self.regressed_error_db})


def equaliser(curve: CurveEstimates, x: Floats, order: int, regressed: NodeWindows | None, refused: str = "") -> Equaliser:
    """Return the inverse of a curve over its domain, a Chebyshev polynomial of an order behind a clamp.

    x̂ = q(min(max(y, y₁), y₂)), q through (p(xᵢ), xᵢ) at the Chebyshev nodes of [y₁, y₂] = p([a, b]); covariance of q from
    that of p by δxᵢ = −δp(xᵢ)/p′(xᵢ). The curve is inverted, not the input regressed on the output: noise in a regressor
    flattens the regression however long the record. x (N,) the inputs of the data; regressed: the paper's way, to compare.
    Raises `WhidError`: "stage-extrapolates" for a domain beyond the data, "stage-not-invertible" for a curve that turns.
    Source [Jeraj and Mathews], section 4, figures 4 and 5.
    """
    a, b = domain = curve.domain
    low, high = float(x.min()), float(x.max())
    if low > a or high < b:
        seen = f"the domain is [{a:.4g}, {b:.4g}], the data cover [{low:.4g}, {high:.4g}]"
        raise WhidError("stage-extrapolates", f"{seen}: try domain: [{max(a, low):.4g}, {min(b, high):.4g}]")
    p = curve.coefficients
    slope = np.asarray(np.polynomial.chebyshev.chebder(p), float)
    _monotone(slope, domain)
    ends = evaluate(np.array([-1.0, 1.0]), p)
    image = (float(ends.min()), float(ends.max()))
    t = _solved(p, unscaled(nodes(order), image))
    rates = -basis(t, len(p) - 1).T / evaluate(t, slope)[:, None]  # ∂t/∂c
    half, d = (b - a) / 2, transform(order)
    at_nodes = half**2 * rates @ curve.covariance @ rates.T
    value, covariance = unscaled(t, domain), d @ at_nodes @ d.T
    q = d @ value
    inside = scaled(x[(x >= a) & (x <= b)], domain)
    back = np.clip(scaled(evaluate(inside, p), image), -1, 1)
    uncertain = half * basis(inside, len(p) - 1) / evaluate(inside, slope)
    variance = float(np.mean(np.einsum("jn,jk,kn->n", uncertain, curve.covariance, uncertain)))
    size, known = rms(x), unscaled(inside, domain)
    error = np.sqrt(rms(evaluate(back, q) - known) ** 2 + variance) / size
    other = regressed.coefficients if regressed else np.full(order + 1, np.nan)
    other_error = rms(evaluate(back, other) - known) / size if regressed else np.nan
    return Equaliser(
        unscaled(nodes(order), image), value, np.sqrt(np.diag(at_nodes)), q, np.sqrt(np.diag(covariance)), covariance, image,
        _decibel(error), other, _decibel(other_error), refused,
    )  # fmt: skip


def image_of(curve: CurveEstimates) -> Domain:
    """Return the outputs at the ends of a curve's domain, ascending."""
    ends = evaluate(np.array([-1.0, 1.0]), curve.coefficients)
    return float(ends.min()), float(ends.max())


def _monotone(slope: Floats, domain: Domain) -> None:
    """Raise unless p′ has one sign on [−1, 1]."""
    roots: Any = np.polynomial.chebyshev.chebroots(np.trim_zeros(slope, "b")) if np.any(slope) else np.empty(0)
    turns = np.sort(roots[np.abs(roots.imag) < 1e-9].real) if len(roots) else np.empty(0)
    at = np.concatenate([[-1.0], turns[np.abs(turns) < 1], [1.0]])
    middle = evaluate((at[1:] + at[:-1]) / 2, slope)
    if not np.all(middle * middle[0] > 0) or np.abs(middle).min() <= FLAT * np.abs(middle).max():
        widest = int(np.argmax(np.diff(at)))
        low, high = unscaled(at[widest : widest + 2], domain)
        places = ", ".join(f"{x:.4g}" for x in unscaled(at[1:-1], domain)) or "every input: it is flat"
        message = f"the curve has no inverse, it turns at {places}; try domain: [{low:.4g}, {high:.4g}]"
        raise WhidError("stage-not-invertible", message)


def _solved(p: Floats, target: Floats) -> Floats:
    """Return t in [−1, 1] with p(t) = target, p monotone, by bisection of all at once."""
    left, right = np.full(len(target), -1.0), np.ones(len(target))
    rising = float(np.sign(np.diff(evaluate(np.array([-1.0, 1.0]), p))[0]))
    for _ in range(HALVINGS):
        middle = (left + right) / 2
        above = rising * (evaluate(middle, p) - target) > 0
        left, right = np.where(above, left, middle), np.where(above, middle, right)
    return np.asarray((left + right) / 2)


def _decibel(ratio: float) -> float:
    return float(20 * np.log10(ratio)) if ratio > 0 else float("nan")
