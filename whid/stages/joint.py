"""Joint complex least squares: f, front and back at every measured frequency at once, no model of the linear blocks."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.fit import Estimate
from whid.quantity import Measured, Quantity, Table
from whid.stages._chain_fit import ChainFit, FreeResponse, frequencies
from whid.stages._responses import Responses, StaticPart, response_metrics
from whid.stages.identifiability import nearest
from whid.stages.rational import Rational

Floats = NDArray[np.float64]


class Joint(NamedTuple):
    """Frequency responses of both blocks where the sines reach them, and f on the levels.

    Phases stand in the gauge of the start values; phase_std leaves the free directions of the gauge out.
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
            tuple(rows), (fit, f"gauge of the phases: {self.gauge}"),
        )  # fmt: skip

    def metrics(self) -> dict[str, Measured]:
        """Return every gain and phase by name, `joint.front.gain@0.02`."""
        return response_metrics("joint", self)


def joint(static: StaticPart, responses: Responses, gauge: Rational, free_breaks: tuple[int, ...] = ()) -> Joint:
    """Fit f, G_front(jω) and G_back(jkω) to levels and complex harmonics; never to angles, which wrap.

    min Σ_levels (f(U) − mean)²/std² + Σ_sines,k |A_k(|x|) e^{jk arg x} G_back(jkω) − H_k|²/std², x = phasor·G_front(jω).
    gauge: the rational fit to the same data, the start; along directions that the data leave free its phases stay, with its
    standard errors. Source [Brouri2019], eqs. (3.23)-(3.24), fitted as complex numbers.
    """
    omegas = frequencies(responses)
    among = np.array([nearest(gauge.back_omega, w) for w in omegas[1]])
    front = gauge.front_gain * np.exp(1j * gauge.front_phase)
    back = (gauge.back_gain * np.exp(1j * gauge.back_phase))[among]
    problem = ChainFit(
        responses, _started(static, gauge.estimate),
        FreeResponse(omegas[0], front, "front"), FreeResponse(omegas[1], back, "back"), free_breaks,
    )  # fmt: skip
    estimate = problem.solve()
    n, m = map(len, omegas)
    skip = len(estimate.names) - 2 * (n + m)
    place = skip + np.r_[n : 2 * n, 2 * n + m : 2 * (n + m)]  # the phases
    of_gauge = np.r_[:n, n + among]
    phase_std = _phase_std(estimate, place, gauge.phase_covariance[np.ix_(of_gauge, of_gauge)])
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


def _phase_std(estimate: Estimate, place: NDArray[np.intp], gauge_covariance: Floats) -> Floats:
    """Standard errors of the phases: within the determined directions from the fit, along the free ones from the gauge."""
    if estimate.rank == len(estimate.names):
        return estimate.std[place]
    in_phase = np.linalg.norm(estimate.null_directions[:, place], axis=1) > 1e-6
    null = np.linalg.qr(estimate.null_directions[in_phase][:, place].T)[0]
    onto_null = null @ null.T
    within = np.eye(len(place)) - onto_null
    total = within @ estimate.covariance[np.ix_(place, place)] @ within + onto_null @ gauge_covariance @ onto_null
    return np.sqrt(np.diag(total))
