"""Descent of a filter-curve-filter chain beside scipy's least squares with finite differences, from the same start."""

import time

import numpy as np
import pytest
from scipy.optimize import least_squares

from whid.blocks.spline import Spline
from whid.fit import Triangle
from whid.stages._cascade import Cascade, Filter
from whid.stages.cascade_fit import Window, _penalty, _rows, cascade_fit, errors, rms_error

SAMPLES = 50_000
KNOTS = np.linspace(-4, 4, 18)
FRONT = Filter.of_roots(np.array([-0.3 + 0j]), np.array([0.85 + 0.25j, 0.85 - 0.25j, 0.7])).padded(3)
BACK = Filter.of_roots(np.array([0.6 + 0.7j, 0.6 - 0.7j]), np.array([0.8 + 0.3j, 0.8 - 0.3j, 0.75])).padded(3)
TRUE = Cascade((FRONT, Spline(inputs=tuple(KNOTS), outputs=tuple(np.tanh(KNOTS))), BACK))


def problem(samples, seed=1):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(samples)
    y = TRUE.response(u) + 1e-3 * rng.standard_normal(samples)
    start = TRUE.replaced(TRUE.values * (1 + 0.03 * rng.standard_normal(len(TRUE.values))))
    return [Window(u, y, np.arange(samples) >= 200)], start


def timed(run, repeats=5):
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        found = run()
        seconds.append(time.perf_counter() - began)
    return float(np.median(seconds)), found


@pytest.mark.slow
def test_beside_scipy_with_finite_differences():
    windows, start = problem(SAMPLES)

    def residual(theta):
        cascade = start.replaced(theta)
        return next(errors(windows, cascade)) if cascade.stable else np.full(SAMPLES - 200, 1e3)

    def by_differences():
        return least_squares(residual, start.values, x_scale="jac", xtol=1e-6, ftol=1e-6, gtol=1e-12, max_nfev=100)

    seconds, (ours, estimate) = timed(lambda: cascade_fit(windows, start))
    scipys, theirs = timed(by_differences)
    rms = float(np.sqrt(2 * theirs.cost / (SAMPLES - 200)))
    print(f"ours {seconds:.2f} s, rms {rms_error(windows, ours):.6f}, {estimate.iterations} iterations")
    print(f"scipy {scipys:.2f} s, rms {rms:.6f}, {theirs.nfev} iterations")
    assert rms_error(windows, ours) < 1.001 * rms
    assert seconds < scipys


@pytest.mark.slow
def test_an_iteration_of_30_numbers_on_100_000_samples():
    windows, start = problem(100_000)
    penalty = _penalty(windows, start)
    assert len(start.values) == 30
    seconds, _ = timed(lambda: Triangle.stacked(_rows(windows, start, penalty)))
    print(f"{seconds:.3f} s an iteration")
    assert seconds < 0.3
