"""Output nonlinearity about the middle of one affine piece, and the response of the linear block, jointly."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly

from whid.fit import Estimate, linear_least_squares
from whid.quantity import Cell, Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._affine_fit import Affine, AffineFit, Complexes, Levels, Tones

TRIALS = np.geomspace(1e-3, 4.0, 120)  # of |G(jω)/G(0)|


class Taylor(NamedTuple):
    """f about the middle of the anchor piece, and G at the sines' frequencies: G(0) = 1, slope of the piece 1.

    f = Σ coefficients[k]·(u − centre)^k on the anchor at rest; a shift to f(0) = 0 comes last.
    """

    centre: Annotated[float, Quantity("input")]
    coefficients: Annotated[Floats, Quantity("output", ("power",), error="coefficients_std")]
    coefficients_std: Annotated[Floats, Quantity("output", ("power",))]
    omega: Annotated[Floats, Quantity("rad/s", ("omega",))]
    gain: Annotated[Floats, Quantity("1", ("omega",), error="gain_std")]
    gain_std: Annotated[Floats, Quantity("1", ("omega",))]
    phase: Annotated[Floats, Quantity("rad", ("omega",), error="phase_std")]
    phase_std: Annotated[Floats, Quantity("rad", ("omega",))]
    estimate: Estimate

    def table(self) -> Table:
        """Return the series, then G."""
        rows: list[tuple[Cell, ...]] = [
            (f"f, power {k}", Measured(float(c), float(s)), None)
            for k, (c, s) in enumerate(zip(self.coefficients, self.coefficients_std, strict=True))
        ]
        columns = (self.omega, self.gain, self.gain_std, self.phase, self.phase_std)
        rows += [
            (f"G at {w:.5g} rad/s", Measured(float(g), float(gs)), Measured(float(p), float(ps)))
            for w, g, gs, p, ps in zip(*columns, strict=True)
        ]
        e = self.estimate
        fit = f"about u = {self.centre:.5g}; χ²/dof {e.chi2:.1f}/{e.dof}, {e.why_stop}"
        return Table("Output nonlinearity and linear block", ("", "coefficient, or gain", "phase, rad"), tuple(rows), (fit,))


def taylor(levels: Levels, tones: Tones, degree: int, phases: list[Floats]) -> tuple[Taylor, AffineFit]:
    """Fit f's Taylor coefficients and G at every frequency to the levels and the sines of one affine piece.

    min Σ_levels (f(u − V) − mean)²/std² + Σ_sines,k |H_k[f(V_e − V + Re G(jω) phasor e^{jωt})] − Y_k|²/std², V the middle
    of the levels. phases: what each sine's static test allows (±π where its branch is open); with 120 gains the starts.
    Source [Brouri2014], eqs. (12), (14)-(23), jointly: a root at every frequency, as there, is off by 20-400 % once the
    root leaves the swept interval.
    """
    centre = float(levels.level.min() + levels.level.max()) / 2
    power = np.arange(degree + 1)
    design = (levels.level - centre)[:, None] ** power
    c = linear_least_squares(design, levels.mean, 1 / levels.std).values
    trials: dict[float, tuple[float, complex]] = {}
    for e, allowed in enumerate(phases):
        cost, gain = _best_gain(c, tones, e, centre, allowed)
        omega = float(tones.omega[e])
        if omega not in trials or cost < trials[omega][0]:
            trials[omega] = cost, gain
    gains = {omega: gain for omega, (_, gain) in trials.items()}
    anchor = int(levels.piece[0])
    estimate, fit = AffineFit(levels, tones, c, {anchor: Affine(centre, 0.0, 1.0, False)}, anchor, gains).solve()
    return told(fit, estimate), fit


def told(fit: AffineFit, estimate: Estimate) -> Taylor:
    """Return f and G of a fit, whatever else was fitted with them."""
    n, m = len(fit.coefficients), len(fit.omegas)
    response = estimate.values[len(estimate.values) - 2 * m :].reshape(m, 2)
    errors = estimate.std[len(estimate.values) - 2 * m :].reshape(m, 2)
    gain = np.exp(response[:, 0])
    phase = (response[:, 1] + np.pi) % (2 * np.pi) - np.pi
    return Taylor(
        fit.pieces[fit.anchor].centre, estimate.values[:n], estimate.std[:n], fit.omegas, gain, gain * errors[:, 0],
        phase, errors[:, 1], estimate,
    )  # fmt: skip


def _best_gain(c: Floats, tones: Tones, e: int, centre: float, phases: Floats) -> tuple[float, complex]:
    """Return χ² and G of the best of all trial gains and allowed phases for one sine."""
    g = np.multiply.outer(TRIALS, np.exp(1j * np.asarray(phases))).ravel()
    samples, n = 4 * len(c) + 4, len(c) - 1
    turn = np.exp(2j * np.pi * np.arange(samples) / samples)
    inner = tones.offset[e] - centre + ((tones.phasor[e] * g)[:, None] * turn).real
    value: Complexes = np.fft.rfft(poly.polyval(inner, c))[:, : n + 1] * 2 / samples
    value[:, 0] /= 2
    cost = np.sum(np.abs((value - tones.value[e]) / tones.std[e]) ** 2, axis=1)
    best = int(np.argmin(cost))
    return float(cost[best]), complex(g[best])
