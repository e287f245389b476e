"""A filter between two curves: first curves, the judge between structures, the curves' band, the floor of a residual."""

import numpy as np
import pytest

from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.blocks.spline import Spline
from whid.blocks.table import Table
from whid.stages._cascade import Cascade, Filter
from whid.stages.cascade_fit import Window, cascade_fit, gauged, knotted, rested
from whid.stages.noise_floor import noise_floor
from whid.stages.static_curves import static_curves
from whid.stages.structures import better, named, structures
from whid.stages.two_curves import two_curves

BETWEEN = Filter.of_roots(np.empty(0), np.array([0.8 + 0.3j, 0.8 - 0.3j]))
F = Table(inputs=(-3.0, -1.0, 0.0, 1.0, 3.0), outputs=(-1.2, -0.9, 0.0, 1.2, 2.6))
G = Table(inputs=(-2.0, 0.0, 1.0, 3.0), outputs=(-0.6, 0.0, 0.8, 1.3))
TRUE = Cascade((F, BETWEEN, G))


def noise(samples, seed):
    return np.random.default_rng(seed).standard_normal(samples)


def window(cascade=TRUE, samples=6000, std=0.01, seed=1):
    u = noise(samples, seed)
    return Window(u, cascade.response(u) + std * noise(samples, seed + 1), np.arange(samples) >= 50)


@pytest.mark.parametrize("g", [G, Table(inputs=(-2.0, 0.2, 3.0), outputs=(1.4, 0.0, 1.7))], ids=["rising", "valley"])
def test_starts_with_the_true_filter_leave_a_few_percent(g):
    w = window(Cascade((F, BETWEEN, g)))
    found = two_curves(w.u, w.y, w.use, [BETWEEN])
    assert found.rms[0] < 0.15 * w.y.std()
    assert np.all(np.diff(found.rms) >= 0)
    best = found.best[0]
    assert np.interp(0.0, best.points[0], best.heights[0]) == pytest.approx(0.0, abs=1e-9)
    assert np.interp(w.u, best.points[0], best.heights[0]).std() == pytest.approx(w.u.std(), rel=1e-6)


def test_the_gauge_is_held_and_the_rest_is_found():
    """Two points of the first curve stay; with them the second curve and the filter are determined."""
    w = window()
    start = gauged(TRUE)
    assert len(start.held) == 6  # two heights, and the ends of both, which may slide on their lines
    found, estimate = cascade_fit([w], start.replaced(start.values * (1 + 0.02 * start.free * noise(len(start.values), 5))))
    assert np.array_equal(found.values[list(start.held)], start.values[list(start.held)])
    assert estimate.rank == start.free.sum() == len(estimate.values)
    z = (estimate.values - start.values[start.free]) / estimate.std
    assert np.mean(z**2) < 1 + 4 * np.sqrt(2 / len(z))


def test_only_a_curve_before_a_filter_and_a_curve_is_held():
    corner, line = Saturation(low=-1.0, high=1.0, fix=("slope",)), Polynomial(coefficients=(0.0, 1.0))
    spline = Spline(inputs=(-3.0, 0.0, 3.0), outputs=(-2.0, 0.7, 2.0))
    assert gauged(Cascade((BETWEEN, spline, BETWEEN))).held == ()
    assert gauged(Cascade((BETWEEN, corner, line))).held == ()
    assert gauged(Cascade((corner, line, BETWEEN, spline))).held == (2, 3)  # after low, high: the line behind the corner


def test_at_rest_moves_a_line_and_nothing_else():
    spline = Spline(inputs=(-3.0, 0.0, 3.0), outputs=(-2.0, 0.7, 2.0))
    before = Cascade((spline, BETWEEN, G))
    after = rested(before)
    assert after.curves[0].value(np.zeros(1))[0] == pytest.approx(0.0, abs=1e-12)
    u = noise(300, 3)
    np.testing.assert_allclose(after.response(u), before.response(u), atol=1e-12)


def test_a_larger_structure_must_be_worth_it():
    w, kept = window(), window(seed=11)
    wiener = cascade_fit([w], Cascade((BETWEEN, knotted([w], TRUE, 8).curves[1])))[0]
    compared = structures([w], [kept], [TRUE, wiener])
    assert compared.chosen == 0
    assert compared.structure == ("hammerstein-wiener, f · 2 · f", "wiener, 2 · f")
    assert compared.selection[0] == pytest.approx(0.01, rel=0.05)
    padded = Cascade((F, BETWEEN, G, Filter.of_roots(np.empty(0), np.array([0.0 + 0j]))))
    for judge in ([], [kept]):
        assert not better([w], judge, padded, TRUE)
        assert better([w], judge, TRUE, wiener)
    assert named(padded) == "chain, f · 2 · f · 1"


def test_the_band_of_a_curve_covers_the_truth():
    """Twenty records: the truth lies within the 95 % band as often as it should, point by point."""
    start = Cascade((BETWEEN, G))
    inside = []
    for seed in range(20):
        w = window(start, samples=1500, seed=100 + 2 * seed)
        found, estimate = cascade_fit([w], start)
        band = static_curves([w], found, estimate)
        inside.append(np.mean(np.abs(band.value[0] - G.value(band.level[0])) < 1.96 * band.std[0]))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.08)  # ±4 of 0.22/√(20·~6 independent stretches)


def test_a_floor_under_a_drift():
    slow = np.cumsum(noise(40_000, 7))
    slow *= 0.5 / slow.std()
    found = noise_floor([noise(40_000, 8) + slow - slow.mean()], 0.01)
    assert found.floor == pytest.approx(1.0, rel=0.02)
    assert found.excess == pytest.approx(0.5, rel=0.1)
    assert 0 < found.below / (2 * np.pi) < 1.0
    assert found.loudest > found.quietest
