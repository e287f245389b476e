"""One sine through a static curve: phase and polynomial from its harmonics."""

from __future__ import annotations

import numpy as np

from whid.fit import Parameter, least_squares
from whid.signal import Floats
from whid.stages._hysteresis import Lumped, Swing

STARTS = 24  # phases in [0, π)


def static_curve_fit(swing: Swing, degree: int) -> Lumped:
    """Return phase and curve, min Σ ((Σ c_k cos^k(θ + phase) − mean)/std)²; both borders are that curve.

    >>> theta = 2 * np.pi * np.arange(100) / 100
    >>> x = np.cos(theta - 0.7)
    >>> found = static_curve_fit(Swing(1.0, 1.0 + 0j, x + 0.3 * x**2, np.full(100, 0.01), 10), degree=2)
    >>> round(found.phase, 6), np.abs(found.rising).round(6)
    (-0.7, array([0. , 1. , 0.3]))
    """
    power = np.arange(degree + 1)
    y, angle = swing.mean, swing.angle

    def residual(x: Floats) -> Floats:
        return np.asarray(np.cos(angle + x[0])[:, None] ** power @ x[1:] - y)

    def tangent(x: Floats) -> Floats:
        z = np.cos(angle + x[0])
        slope = np.polynomial.polynomial.polyval(z, np.polynomial.polynomial.polyder(x[1:]))
        return np.column_stack([-np.sin(angle + x[0]) * slope, z[:, None] ** power])

    rated = []
    for phase in np.pi * np.arange(STARTS) / STARTS:
        names = [Parameter("phase", float(phase), "rad")] + [Parameter(f"curve.{k}", 0.0) for k in power]
        rated.append(least_squares(residual, tangent, names, 1 / swing.std, max_iterations=3))
    best = None
    for start in sorted(rated, key=lambda e: e.chi2)[:4]:
        names = [Parameter(str(k), float(v)) for k, v in enumerate(start.values)]
        end = least_squares(residual, tangent, names, 1 / swing.std, max_iterations=60, tolerance=1e-4)
        best = end if best is None or end.chi2 < best.chi2 else best
    assert best is not None
    phase = float(np.pi / 2 - np.mod(np.pi / 2 - best.values[0], np.pi))
    curve, std = best.values[1:], best.std[1:]
    if round((float(best.values[0]) - phase) / np.pi) % 2:
        curve = curve * (-1.0) ** power
    return Lumped(swing.omega, swing.amplitude, phase, float(best.std[0]), curve, std, curve, std)
