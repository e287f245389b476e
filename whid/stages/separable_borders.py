"""The paper's separable least squares: borders for every phase, the phase of the smallest rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.fit import Parameter, least_squares, linear_least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._hysteresis import Lumped, Swing, lumped
from whid.stages.constant_stages import Flat, border_rows, flat_stretches, outside

GRID = 96  # phases of a scan


class SeparableBorders(NamedTuple):
    """Separable least squares: phase and lumped borders by (24)-(25), one row a sine; phases in (−π/2, π/2]."""

    omega: Annotated[Floats, Quantity("rad/s", ("sine",))]
    amplitude: Annotated[Floats, Quantity("input", ("sine",))]
    phase: Annotated[Floats, Quantity("rad", ("sine",), error="phase_std")]
    phase_std: Annotated[Floats, Quantity("rad", ("sine",))]
    rising: Annotated[Floats, Quantity("output", ("sine", "power"), error="rising_std")]
    rising_std: Annotated[Floats, Quantity("output", ("sine", "power"))]
    falling: Annotated[Floats, Quantity("output", ("sine", "power"), error="falling_std")]
    falling_std: Annotated[Floats, Quantity("output", ("sine", "power"))]
    reduced_chi2: Annotated[Floats, Quantity("1", ("sine",))]
    stages: Annotated[Floats, Quantity("1", ("sine",))]  # constant stages left out: 0, 1 or 2

    def table(self) -> Table:
        """Return one row a sine."""
        rows = tuple(
            (float(f"{w:.6g}"), float(f"{u:.6g}"), int(n), Measured(float(p), float(s)), float(f"{c:.4g}"))
            for w, u, n, p, s, c in zip(
                self.omega, self.amplitude, self.stages, self.phase, self.phase_std, self.reduced_chi2, strict=True
            )
        )
        columns = ("ω, rad/s", "amplitude", "stages left out", "phase by (25a), rad", "χ²/dof")
        return Table("Separable least squares", columns, rows)

    def row(self, k: int) -> Lumped:
        """Return one sine."""
        return Lumped(*(getattr(self, name)[k] for name in Lumped._fields))


def separable_borders(swings: Sequence[Swing], degree: int) -> SeparableBorders:
    """Return (24)-(25): at a phase the borders are linear least squares; the phase is where what is left is least.

    Samples of constant stages are left out whatever the phase, so that all phases are judged on the same data; the argmin is
    over [0, π) (the paper prints min, over [0, π]). Scan, then descent in all numbers, which gives the covariance.
    Source [Giri], eqs. (22), (24)-(25); its Table 1 corrected as in `constant_stages`.

    >>> theta = 2 * np.pi * np.arange(200) / 200
    >>> w = np.cos(theta - 0.5) + np.where(np.sin(theta - 0.5) >= 0, 0.1, -0.1) * np.sin(theta - 0.5) ** 2
    >>> found = separable_borders([Swing(1.0, 1.0 + 0j, w, np.full(200, 1e-4), 20)], degree=2)
    >>> found.phase.round(6), found.falling.round(6)
    (array([-0.5]), array([[ 0.1,  1. , -0.1]]))
    """
    found = [_separated(swing, flat_stretches(swing), degree) for swing in swings]
    rows = [one for one, _, _ in found]
    return SeparableBorders(
        **{name: np.array([getattr(one, name) for one in rows]) for name in Lumped._fields},
        reduced_chi2=np.array([chi2 for _, chi2, _ in found]),
        stages=np.array([float((f.first > 0) + (f.second > 0)) for _, _, f in found]),
    )  # fmt: skip


def _separated(swing: Swing, flat: Flat, degree: int) -> tuple[Lumped, float, Flat]:
    keep = outside(swing, flat)
    angle, y, weight = swing.angle[keep], swing.mean[keep], 1 / swing.std[keep]
    n = degree + 1
    if keep.sum() <= 4 * n:
        nothing = np.full(n, np.nan)
        return Lumped(swing.omega, swing.amplitude, np.nan, np.nan, nothing, nothing, nothing, nothing), np.nan, flat

    def at(phase: float) -> tuple[float, Floats]:
        fit = linear_least_squares(border_rows(angle + phase, degree), y, weight)
        return fit.chi2, fit.values

    def residual(x: Floats) -> Floats:
        return np.asarray(border_rows(angle + x[0], degree) @ x[1:] - y)

    def tangent(x: Floats) -> Floats:
        slope = np.hstack(
            [np.polynomial.polynomial.polyder(x[1 : n + 1]), [0], np.polynomial.polynomial.polyder(x[n + 1 :]), [0]]
        )
        rows = border_rows(angle + x[0], degree)
        return np.column_stack([-np.sin(angle + x[0]) * (rows @ slope), rows])

    phases = np.pi * np.arange(GRID) / GRID
    scanned = [at(float(phase)) for phase in phases]
    costs = np.array([cost for cost, _ in scanned])
    ends = []
    for k in np.argsort(costs)[:3]:
        start = np.append(phases[k], scanned[k][1])
        names = [Parameter(str(i), float(v)) for i, v in enumerate(start)]
        ends.append(least_squares(residual, tangent, names, weight, max_iterations=40, tolerance=1e-4))
    best = min(ends, key=lambda e: e.chi2)
    return lumped(best, swing.omega, swing.amplitude), best.reduced_chi2, flat
