"""Bars C1 and C2: the separable phase at its Cramér-Rao bound, the sizes of the constant and the static test."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.brouri2014 import F1, F2, H1, H2, response
from whid.errors import WhidError
from whid.quantity import Measured
from whid.stages.constant_test import constant_test
from whid.stages.periods import harmonics
from whid.stages.static_test import lissajous_cost, on_branch, static_test

K, N = 200, 20
SINES = {"A1": (1.1, 0.45, H1, F1), "A2": (-1.15, 0.6, H2, F2)}  # offset, amplitude at ω = 1


@lru_cache
def settled(which, omega=1.0):
    """One settled period of the plant under a sine that stays on one piece, from its formula."""
    offset, amplitude, h, f = SINES[which]
    inside = h.value(offset + amplitude * np.array([-1.0, 0.0, 1.0]))
    slope = (inside[2] - inside[0]) / (2 * amplitude)
    assert np.isclose(inside[1], inside[[0, 2]].mean(), atol=1e-12)  # the same piece
    g, g0 = response(which, omega), response(which, 0.0).real
    turn = np.exp(2j * np.pi * np.arange(K) / K)
    return f.value(g0 * inside[1] + slope * amplitude * np.real(g * turn))


def bound(clean, std, degree, phase):
    """CRB of the phase beside the harmonics of any even curve, from the Jacobian of N·K samples."""
    angle = 2 * np.pi * np.arange(K) / K + phase
    curve = np.cos(np.outer(angle, np.arange(degree + 1)))
    along = np.linalg.lstsq(curve, clean, rcond=None)[0]
    rate = -np.sin(np.outer(angle, np.arange(degree + 1))) @ (np.arange(degree + 1) * along)
    return std / np.sqrt(N * np.linalg.inv(np.column_stack([rate, curve]).T @ np.column_stack([rate, curve]))[0, 0] ** -1)


def phase_rmse(which, snr, runs, seed):
    """RMSE of the phase over its bound, and the share of runs whose branch the true slope resolves."""
    clean = settled(which)
    std = np.sqrt(np.var(clean) / 10 ** (snr / 10))
    true = float(np.angle(response(which, 1.0)))
    error = np.empty(runs)
    for run in range(runs):
        y = np.tile(clean, N) + std * np.random.default_rng([seed, snr + 100, run]).standard_normal(N * K)
        found = static_test(harmonics(y, K, 0), 3)
        error[run] = (found.phase - true + np.pi / 2) % np.pi - np.pi / 2
    return float(np.sqrt(np.mean(error**2))), bound(clean, std, 3, true)


def interval(runs):
    """How far RMSE/CRB may be from 1 by chance: 3 standard deviations of √(χ²/n)."""
    return 3 / np.sqrt(2 * runs)


@pytest.mark.parametrize("which", ["A1", "A2"])
def test_c1_phase_reduced(which):
    for snr in (-10, 40):
        rmse, crb = phase_rmse(which, snr, 60, 1)
        print(f"C1 {which} {snr} dB: RMSE {rmse:.3g}, CRB {crb:.3g}, ratio {rmse / crb:.3f}")
        assert abs(rmse / crb - 1) < 0.15 + interval(60)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["A1", "A2"])
@pytest.mark.parametrize("snr", range(-10, 61, 10))
def test_c1_phase(which, snr):
    rmse, crb = phase_rmse(which, snr, 400, 50_000)
    print(f"C1 {which} {snr} dB: RMSE {rmse:.3g}, CRB {crb:.3g}, ratio {rmse / crb:.3f} (400 runs)")
    assert 0.85 <= rmse / crb <= 1.15


def test_the_bound_is_the_published_one():
    clean = settled("A1")
    assert bound(clean, np.sqrt(np.var(clean) / 1e4), 3, np.angle(response("A1", 1.0))) == pytest.approx(1.56e-4, rel=5e-3)


def rejected(runs, seed, curve=None, rho=0.0, periods=N):
    """The share of constants, or of static curves, called something else."""
    count = 0
    for run in range(runs):
        noise = np.random.default_rng([seed, run]).standard_normal(periods * 100)
        noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise) if rho else noise
        y = noise if curve is None else noise + np.tile(curve, periods)
        found = harmonics(y, 100, 0)
        count += not (constant_test(found).constant if curve is None else static_test(found, 3).static)
    return count / runs


CURVE = 2 * np.polynomial.chebyshev.chebval(np.cos(2 * np.pi * np.arange(100) / 100 - 0.7), [1.0, 2.0, 0.5, 0.2])


@pytest.mark.parametrize("curve", [None, CURVE], ids=["constant", "static"])
@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_c2_size_reduced(curve, rho):
    """400 runs, the bar's interval widened by 3 binomial deviations."""
    size = rejected(400, 2, curve, rho)
    print(f"C2 size {size:.4f} over 400 runs")
    assert size == pytest.approx(0.0105, abs=0.0055 + 3 * np.sqrt(0.0099 / 400))


@pytest.mark.slow
@pytest.mark.parametrize("curve", [None, CURVE], ids=["constant", "static"])
@pytest.mark.parametrize(("rho", "periods"), [(0.0, 20), (0.9, 20), (0.0, 5)])
def test_c2_size(curve, rho, periods):
    size = rejected(3000, 50_002, curve, rho, periods)
    print(f"C2 {'constant' if curve is None else 'static'} test: size {size:.4f}, rho {rho}, {periods} periods (3000 runs)")
    assert 0.005 <= size <= 0.016


def test_a_curve_with_a_kink_is_not_static():
    """A sine that leaves its piece by a tenth of its amplitude: a kink behind a filter is no polynomial curve."""
    t = 2 * np.pi * np.arange(K) / K
    clipped = np.minimum(np.cos(t), 0.9)
    spectrum = np.fft.rfft(clipped) / (1 + 0.5j * np.arange(K // 2 + 1))
    y = np.tile(np.fft.irfft(spectrum), N) + 0.002 * np.random.default_rng(0).standard_normal(N * K)
    found = static_test(harmonics(y, K, 0), 3)
    assert not found.static
    assert "left its piece" in found.table().notes[0]


def test_the_minimum_is_the_least_of_all_phases():
    """Against a grid of 20 000 phases, on random harmonics that no curve made."""
    rng = np.random.default_rng(4)
    phase = np.linspace(-np.pi / 2, np.pi / 2, 20_001)
    base = harmonics(rng.standard_normal(1000), 50, 0)
    for degree in (1, 2, 3, 5, 8):
        for _ in range(10):
            value = rng.standard_normal(21) + 1j * rng.standard_normal(21)
            found = base._replace(value=value, value_std=np.exp(rng.standard_normal(21)))
            best = static_test(found, degree)
            cost = lissajous_cost(found, degree, np.append(phase, best.phase))
            assert cost[-1] <= cost[:-1].min() + 1e-12
            assert cost[-1] > cost[:-1].min() - 1e-2 * cost.max()


def test_an_even_curve_leaves_its_phase_ambiguous():
    """cos² alone: the curve is static a quarter turn further as well (Proposition 1(2) is false there)."""
    n = np.arange(K * N)
    y = np.cos(2 * np.pi * n / K - 0.4) ** 2 + 0.01 * np.random.default_rng(3).standard_normal(len(n))
    found = static_test(harmonics(y, K, 0), 2)
    assert found.ambiguous
    turns = np.sort(np.append(found.rivals, found.phase)) + 0.4
    assert np.allclose(np.round(turns / (np.pi / 2)), turns / (np.pi / 2), atol=0.01)
    assert on_branch(found, Measured(1.0, 0.01)).branch == "open"


@pytest.mark.parametrize("true", [-3.0, -1.7, -0.4, 0.3, 1.2, 2.9])
def test_the_branch_follows_the_staircase(true):
    x = np.cos(2 * np.pi * np.arange(K * N) / K + true)
    y = 1 - x + 0.3 * x**2 + 0.01 * np.random.default_rng(3).standard_normal(len(x))
    found = on_branch(static_test(harmonics(y, K, 0), 2), Measured(-1.0, 0.1))
    assert found.branch == "resolved"
    assert found.phase == pytest.approx(true, abs=5 * found.phase_std)
    assert found.along[1] == pytest.approx(-1, abs=0.01)


def test_the_drive_is_the_reference_of_the_phase():
    x = np.cos(2 * np.pi * np.arange(K * N) / K - 0.2)
    assert static_test(harmonics(x, K, 0), 1, drive=2 * np.exp(0.5j)).phase == pytest.approx(-0.7, abs=1e-9)


def test_too_few_harmonics_for_a_degree():
    with pytest.raises(WhidError, match="degree 5") as fault:
        static_test(harmonics(np.cos(np.arange(200.0)), 10, 0, count=4), 5)
    assert fault.value.code == "stage-too-short"


def test_one_period_tests_nothing():
    found = constant_test(harmonics(np.cos(2 * np.pi * np.arange(100) / 100), 100, 0))
    assert (found.dof, found.p, found.constant) == (0, 1.0, True)
    assert "nothing to test" in found.table().notes[0]
