"""Joint complex least squares: f, front and back at every measured frequency at once, no model of the linear blocks."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.fit import NEAR, Estimate
from whid.quantity import Measured, Quantity, Table
from whid.stages._chain_fit import ChainFit, FreeResponse, frequencies
from whid.stages._responses import Responses, StaticPart, response_metrics
from whid.stages.identifiability import nearest
from whid.stages.rational import Rational

Floats = NDArray[np.float64]


class Joint(NamedTuple):
    """Frequency responses of both blocks where the sines reach them, and f on the levels.

    Phases are as near to the gauge's as the data allow; phase_std holds the gauge's own error along what they leave free.
    """

    front_omega: Annotated[Floats, Quantity("rad/s", dims=("front_omega",))]
    front_gain: Annotated[Floats, Quantity(dims=("front_omega",), error="front_gain_std")]
    front_gain_std: Annotated[Floats, Quantity(dims=("front_omega",))]
    front_phase: Annotated[Floats, Quantity("rad", dims=("front_omega",), error="front_phase_std")]
    front_phase_std: Annotated[Floats, Quantity("rad", dims=("front_omega",))]
    back_omega: Annotated[Floats, Quantity("rad/s", dims=("back_omega",))]
    back_gain: Annotated[Floats, Quantity(dims=("back_omega",), error="back_gain_std")]
    back_gain_std: Annotated[Floats, Quantity(dims=("back_omega",))]
    back_phase: Annotated[Floats, Quantity("rad", dims=("back_omega",), error="back_phase_std")]
    back_phase_std: Annotated[Floats, Quantity("rad", dims=("back_omega",))]
    gauge: str
    estimate: Estimate

    def table(self) -> Table:
        """Return one row a block and frequency."""
        rows = []
        for block in ("front", "back"):
            columns = (getattr(self, f"{block}_{name}") for name in ("omega", "gain", "gain_std", "phase", "phase_std"))
            for w, g, gs, p, ps in zip(*columns, strict=True):
                rows.append((block, float(w), Measured(float(g), float(gs)), Measured(float(p), float(ps))))
        fit = f"χ²/dof {self.estimate.chi2:.1f}/{self.estimate.dof}, rank {self.estimate.rank} of {len(self.estimate.names)}"
        return Table(
            "Joint estimate at the measured frequencies", ("block", "ω, rad/s", "|G(jω)|", "arg G(jω), rad"),
            tuple(rows), (fit, f"gauge of the phases: {self.gauge}", *self._stopped()),
        )  # fmt: skip

    def _stopped(self) -> tuple[str, ...]:
        return () if self.estimate.why_stop == "converged" else (f"not converged: {self.estimate.why_stop}",)

    def metrics(self) -> dict[str, Measured]:
        """Return every gain and phase by name, `joint.front.gain@0.02`."""
        return response_metrics("joint", self)


def joint(static: StaticPart, responses: Responses, gauge: Rational, free_breaks: tuple[int, ...] = ()) -> Joint:
    """Fit f, G_front(jω) and G_back(jkω) to levels and complex harmonics; never to angles, which wrap.

    min Σ_levels (f(U) − mean)²/std² + Σ_sines,k |A_k(|x|) e^{jk arg x} G_back(jkω) − H_k|²/std², x = phasor·G_front(jω).
    gauge: the rational fit to the same data, the start; along directions that the data leave free its phases are taken, with
    their standard errors. Source [Brouri2019], eqs. (3.23)-(3.24), fitted as complex numbers.
    """
    omegas = frequencies(responses)
    among = nearest(gauge.back_omega, omegas[1])
    front = gauge.front_gain * np.exp(1j * gauge.front_phase)
    back = (gauge.back_gain * np.exp(1j * gauge.back_phase))[among]
    problem = ChainFit(
        responses, _started(static, gauge.estimate),
        FreeResponse(omegas[0], front, "front"), FreeResponse(omegas[1], back, "back"), free_breaks,
    )  # fmt: skip
    estimate = problem.solve(damping=NEAR)
    n, m = map(len, omegas)
    skip = len(estimate.names) - 2 * (n + m)
    place = skip + np.r_[n : 2 * n, 2 * n + m : 2 * (n + m)]  # the phases
    of_gauge = np.r_[:n, n + among]
    gauged = np.append(gauge.front_phase, gauge.back_phase)[of_gauge]
    phases, phase_std = _gauged(estimate, place, gauged, gauge.phase_covariance[np.ix_(of_gauge, of_gauge)])
    estimate.values[place] = phases
    fg, fp, bg, bp = np.split(estimate.values[skip:], np.cumsum([n, n, m]))
    fgs, _, bgs, _ = np.split(estimate.std[skip:], np.cumsum([n, n, m]))
    return Joint(
        omegas[0], np.exp(fg), np.exp(fg) * fgs, fp, phase_std[:n],
        omegas[1], np.exp(bg), np.exp(bg) * bgs, bp, phase_std[n:], "joint rational fit", estimate,
    )  # fmt: skip


def _started(static: StaticPart, fitted: Estimate) -> StaticPart:
    """Return f as another fit of the same data left it: from there χ² only falls."""
    coefficients, breaks = static.coefficients.copy(), static.breaks.copy()
    for name, value in zip(fitted.names, fitted.values, strict=True):
        block, part, *place = name.split(".")
        if block == "f":
            (coefficients if part == "pieces" else breaks)[tuple(map(int, place))] = value
    return static._replace(coefficients=coefficients, breaks=breaks)


def _gauged(estimate: Estimate, place: NDArray[np.intp], gauged: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return phases as near to the gauge's as the free directions allow, and their standard errors.

    φ = Pφ_fit + (1 − P)φ_gauge, P off the free directions. The gauge is the efficient fit of a smaller model to the same
    data, so that cov(φ_fit, φ_gauge) = C_gauge and cov φ = C_gauge + P(C_fit − C_gauge)P.
    """
    phases = estimate.values[place]
    phases = phases + 2 * np.pi * np.round((gauged - phases) / (2 * np.pi))
    if estimate.rank == len(estimate.names):
        return phases, estimate.std[place]
    in_phase = np.linalg.norm(estimate.null_directions[:, place], axis=1) > 1e-6
    null = np.linalg.qr(estimate.null_directions[in_phase][:, place].T)[0]
    within = np.eye(len(place)) - null @ null.T
    total = covariance + within @ (estimate.covariance[np.ix_(place, place)] - covariance) @ within
    return gauged + within @ (phases - gauged), np.sqrt(np.maximum(np.diag(total), 0.0))
