"""The paper's own estimates from its Lissajous curves, and the efficient ones in the paper's scaling."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from whid.fit import Estimate
from whid.quantity import Cell, Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._affine_fit import AffineFit, real_roots, shifted
from whid.stages.static_test import StaticTest

STEP = 1e-4  # of a standard error: the difference that carries errors over


class Lissajous(NamedTuple):
    """Phase, gain and f from one curve a frequency (the paper's Tables 1 and 2), scaled to S = 1 and Σ|cᵢ|^{n/i} = 1."""

    omega: Annotated[Floats, Quantity("rad/s", ("omega",))]
    phase: Annotated[Floats, Quantity("rad", ("omega",), error="phase_std")]
    phase_std: Annotated[Floats, Quantity("rad", ("omega",))]
    gain: Annotated[Floats, Quantity("1", ("omega",), error="gain_std")]
    gain_std: Annotated[Floats, Quantity("1", ("omega",))]
    coefficients: Annotated[Floats, Quantity("output", ("power",), error="coefficients_std")]  # c₁ … cₙ, c₀ = 0
    coefficients_std: Annotated[Floats, Quantity("output", ("power",))]
    root: Annotated[Floats, Quantity("input", ("omega",))]  # where the curve crosses zero, from the middle of the sine
    inside: Annotated[NDArray[np.bool_], Quantity("1", ("omega",))]  # that is within the swing; else it is extrapolated

    def table(self) -> Table:
        """Return one row a frequency, then f."""
        rows = _rows(self)
        outside = int((~self.inside).sum())
        notes = [
            f"the curve's zero lies beyond the swing at {outside} of {len(self.inside)} frequencies: it is extrapolated"
        ]
        return Table("As in the paper: a curve a frequency", ("", "gain, or coefficient", "phase, rad"), rows, tuple(notes))

    def metrics(self) -> dict[str, Measured]:
        """Return `paper.linear.gain@ω`, `paper.linear.phase@ω` and `paper.f.k`."""
        return {f"paper.{name}": value for name, value in _named(self).items()}


class PaperScale(NamedTuple):
    """Phase, gain and f of the joint fit of all levels and curves, scaled as the paper does."""

    omega: Annotated[Floats, Quantity("rad/s", ("omega",))]
    phase: Annotated[Floats, Quantity("rad", ("omega",), error="phase_std")]
    phase_std: Annotated[Floats, Quantity("rad", ("omega",))]
    gain: Annotated[Floats, Quantity("1", ("omega",), error="gain_std")]
    gain_std: Annotated[Floats, Quantity("1", ("omega",))]
    coefficients: Annotated[Floats, Quantity("output", ("power",), error="coefficients_std")]
    coefficients_std: Annotated[Floats, Quantity("output", ("power",))]
    static_gain: Annotated[float, Quantity("1", error="static_gain_std")]
    static_gain_std: Annotated[float, Quantity("1")]

    def table(self) -> Table:
        """Return one row a frequency, then f."""
        rows = (("G at 0 rad/s", Measured(self.static_gain, self.static_gain_std), None), *_rows(self))
        note = "slope 1 on the anchor and Σ|cᵢ|^{n/i} = 1, eq. (16)"
        return Table("Joint fit in the paper's scaling", ("", "gain, or coefficient", "phase, rad"), rows, (note,))

    def metrics(self) -> dict[str, Measured]:
        """Return `linear.gain@ω`, `linear.phase@ω` and `f.k`."""
        return _named(self)


def lissajous(omega: Floats, tests: Sequence[StaticTest], amplitude: Floats) -> Lissajous:
    """Return the paper's estimates from the static curves of sines on one affine piece.

    y = Σ c̃ᵢ(ω) zⁱ, z of amplitude A, by its harmonics (eq. (14)); z moved to the zero of the curve, so that c̃₀ = 0;
    |G(jω)| = (Σ|c̃ᵢ|^{n/i})^{1/n} (22); cᵢ = Σ_ω c̃ᵢ / Σ_ω |G|ⁱ (23). Corrected: the shift is X/(S|G|), not X; phases by
    the exact minimum, not by eye. Standard errors by the curves' own; omega (m,), amplitude (m,) of the sines. A curve
    without a zero is moved to where it comes nearest to one. Source [Brouri2014], Tables 1-2.

    >>> from whid.stages.periods import harmonics
    >>> from whid.stages.static_test import static_test
    >>> x = 0.5 + np.cos(0.02 * np.pi * np.arange(2000) - 0.7)
    >>> test = static_test(harmonics(x + 0.3 * x**2, 100), 2)
    >>> found = lissajous(np.array([1.0]), [test], np.array([1.0]))
    >>> found.coefficients.round(3), found.gain.round(3)  # |G|² = 1² + .3, c₁² + c₂ = 1
    (array([0.877, 0.231]), array([1.14]))
    """
    m, n = len(tests), len(tests[0].along) - 1
    moved, covariance = np.empty((m, n)), np.zeros((m * n, m * n))
    for e, (test, a) in enumerate(zip(tests, amplitude, strict=True)):
        own = slice(e * n, (e + 1) * n)
        moved[e], covariance[own, own] = carried(partial(_coefficients, amplitude=a), test.along, np.diag(test.along_std**2))
    values, covariance = carried(lambda flat: _scaled(flat.reshape(m, n)), moved.ravel(), covariance)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    roots = np.array([about_zero(test.along, a)[1] for test, a in zip(tests, amplitude, strict=True)])
    phase, phase_std = (np.array([getattr(test, name) for test in tests]) for name in ("phase", "phase_std"))
    return Lissajous(
        omega, phase, phase_std, values[:m], std[:m], values[m:], std[m:], roots, np.abs(roots) <= amplitude
    )  # fmt: skip


def paper_scale(fit: AffineFit, estimate: Estimate, root: float) -> PaperScale:
    """Return a joint fit's f and G in the paper's scaling, with errors carried over.

    root: the x at which f vanishes, near the one to shift by.
    """
    count, m = len(fit.coefficients), len(fit.omegas)

    def numbers(theta: Floats) -> Floats:
        c, g = theta[:count], theta[count : count + 2 * m].reshape(m, 2)
        zeros = real_roots(c)
        x0 = float(zeros[np.argmin(np.abs(zeros - root))]) if len(zeros) else root
        moved = shifted(c, x0)[1:]
        size = _size(moved)
        return np.concatenate([[size], np.exp(g[:, 0]) * size, moved / size ** np.arange(1, count)])

    own = np.r_[:count, len(estimate.values) - 2 * m : len(estimate.values)]
    values, covariance = carried(numbers, estimate.values[own], estimate.covariance[np.ix_(own, own)])
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    g = estimate.values[len(estimate.values) - 2 * m :].reshape(m, 2)
    phase = (g[:, 1] + np.pi) % (2 * np.pi) - np.pi
    phase_std = estimate.std[len(estimate.values) - 2 * m :].reshape(m, 2)[:, 1]
    gain, c = slice(1, m + 1), slice(m + 1, None)
    return PaperScale(
        fit.omegas, phase, phase_std, values[gain], std[gain], values[c], std[c], float(values[0]), float(std[0])
    )


def about_zero(along: Floats, amplitude: float) -> tuple[Floats, float]:
    """Return c̃₁ … c̃ₙ about the zero of a curve given by its harmonics, and that zero."""
    c = np.asarray(chebyshev.cheb2poly(along), float)
    c = np.pad(c, (0, len(along) - len(c))) / amplitude ** np.arange(len(along))
    zeros = real_roots(c)
    if not len(zeros):
        zeros = np.append(real_roots(poly.polyder(c)), 0.0)
        zeros = zeros[[int(np.argmin(np.abs(np.asarray(poly.polyval(zeros, c)))))]]
    root = float(zeros[np.argmin(np.abs(zeros))])
    return shifted(c, root)[1:], root


def _coefficients(along: Floats, amplitude: float) -> Floats:
    return about_zero(along, amplitude)[0]


def _size(c: Floats) -> float:
    """Return (Σ|cᵢ|^{n/i})^{1/n}, i = 1 … n, eq. (19)."""
    n = len(c)
    return float(np.sum(np.abs(c) ** (n / np.arange(1, n + 1))) ** (1 / n))


def _scaled(c: Floats) -> Floats:
    """Return gains at m frequencies, then c₁ … cₙ, eqs. (22)-(23)."""
    gain = np.array([_size(row) for row in c])
    return np.append(gain, c.sum(axis=0) / (gain[:, None] ** np.arange(1, c.shape[1] + 1)).sum(axis=0))


def carried(numbers: Callable[[Floats], Floats], at: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return numbers(θ) and their covariance by differences."""
    std = np.sqrt(np.diag(covariance))
    steps = np.where(std > 0, STEP * std, 1e-9)
    rates = np.column_stack(
        [(numbers(at + d) - numbers(at - d)) / (2 * s) for d, s in zip(np.diag(steps), steps, strict=True)]
    )
    return numbers(at), rates @ covariance @ rates.T


def _rows(found: Lissajous | PaperScale) -> tuple[tuple[Cell, ...], ...]:
    columns = (found.omega, found.gain, found.gain_std, found.phase, found.phase_std)
    rows: list[tuple[Cell, ...]] = [
        (f"G at {w:.5g} rad/s", Measured(float(g), float(gs)), Measured(float(p), float(ps)))
        for w, g, gs, p, ps in zip(*columns, strict=True)
    ]
    pairs = zip(found.coefficients, found.coefficients_std, strict=True)
    return (*rows, *((f"f, power {k}", Measured(float(c), float(s)), None) for k, (c, s) in enumerate(pairs, 1)))


def _named(found: Lissajous | PaperScale) -> dict[str, Measured]:
    named = {}
    for k, w in enumerate(found.omega):
        named[f"linear.gain@{w:.6g}"] = Measured(float(found.gain[k]), float(found.gain_std[k]))
        named[f"linear.phase@{w:.6g}"] = Measured(float(found.phase[k]), float(found.phase_std[k]))
    for k, (c, s) in enumerate(zip(found.coefficients, found.coefficients_std, strict=True), 1):
        named[f"f.{k}"] = Measured(float(c), float(s))
    return named
