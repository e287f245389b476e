"""Bars D2, D3, D4 on averaged periods; the paper's estimates, corrected and as printed; loops that close, or stick."""

import numpy as np
import pytest

from tests.giri import AMPLITUDES, B1, B2, B3, B4, OMEGA, g1, noise_std, period
from whid.stages._hysteresis import Lumped, Swing, dual, other_branch, response, steady_loop
from whid.stages.constant_stages import constant_stages
from whid.stages.joint_loops import joint_loops, paper_scale, wrapped
from whid.stages.linked_loop import linked_loop
from whid.stages.paper_borders import paper_borders
from whid.stages.periods import harmonics
from whid.stages.separable_borders import separable_borders
from whid.stages.static_or_backlash import static_or_backlash

M, PERIODS = 256, 20
PLANTS = {"B1": B1, "B2": B2}


def swing(borders, omega, amplitude, snr, seed):
    w = period(borders, omega, amplitude)
    std = noise_std(w, snr) / np.sqrt(PERIODS)
    noise = std * np.random.default_rng(seed).normal(size=M)
    return Swing(omega, complex(amplitude), w + noise, np.full(M, std), PERIODS)


def truth(borders, omega, amplitude):
    size = (amplitude * abs(g1(omega))) ** np.arange(4)
    return np.concatenate([[np.angle(g1(omega))], *(np.array(b) * size for b in borders)])


def bound(borders, one):
    """Cramér-Rao of phase and lumped borders, by differences of the reference operator's own limit: the analytic loop."""
    true = truth(borders, one.omega, one.amplitude)
    _, by_angle, by_border = response(true[1:5], true[5:], one.angle + true[0])
    j = np.column_stack([by_angle, by_border]) / one.std[:, None]
    return np.sqrt(np.diag(np.linalg.inv(j.T @ j)))


def errors(found, true):
    """Estimate − truth, on the truth's branch."""
    if abs(wrapped(found.phase - true[0])) > np.pi / 2:
        found = other_branch(found)
    return np.concatenate([[wrapped(found.phase - true[0])], found.rising - true[1:5], found.falling - true[5:]])


def lump(found):
    return Lumped(*found[:8])


@pytest.mark.parametrize("name", [*PLANTS, "B3"])
@pytest.mark.parametrize("amplitude", AMPLITUDES)
def test_the_analytic_loop_is_that_of_the_rule(name, amplitude):
    borders = {**PLANTS, "B3": B3}[name]
    true = truth(borders, 1.0, amplitude)
    w, *_ = response(true[1:5], true[5:], 2 * np.pi * np.arange(M) / M + true[0])
    np.testing.assert_allclose(w, period(borders, 1.0, amplitude), atol=1e-13)


def test_its_derivatives():
    x = np.array([-0.3, 0.7, 0.8, -0.8, -0.2, 0.7, 0.7, -0.1])
    angle = 2 * np.pi * np.arange(40) / 40 + 0.3
    _, by_angle, by_border = response(x[:4], x[4:], angle)
    h = 1e-6
    for k, step in enumerate(np.eye(8) * h):
        up, down = (response((x + s)[:4], (x + s)[4:], angle)[0] for s in (step, -step))
        np.testing.assert_allclose(by_border[:, k], (up - down) / (2 * h), atol=1e-8)
    up, down = (response(x[:4], x[4:], angle + s)[0] for s in (h, -h))
    np.testing.assert_allclose(by_angle, (up - down) / (2 * h), atol=1e-8)


def test_kinds_of_loops():
    assert steady_loop(np.array([-0.2, 1.0]), np.array([0.2, 1.0])).kind == "full"
    assert steady_loop(np.array(B4[0]), np.array(B4[1])).kind == "constant"
    assert steady_loop(np.array([0.0, 0.1, -1.0]), np.array([2.0, 0.1, 0.0])).kind == "one-sided"
    crossed = np.array([1e-4, 1.0]), np.array([-1e-4, 1.0])
    assert (steady_loop(*crossed).kind, steady_loop(*crossed, touch=1e-3).kind) == ("constant", "full")


def one_record(name, snr, seeds, omega=1.0):
    found, limit, ones = [], None, 0
    for seed in seeds:
        one = swing(PLANTS[name], omega, 1.0, snr, seed)
        limit = bound(PLANTS[name], one)
        fit = linked_loop(one.mean, one.std, 3, omega, 1.0, one.drive)
        e = errors(lump(fit), truth(PLANTS[name], omega, 1.0)) / limit
        ones += abs(e).max() < 6
        found.append(e)
    return np.array(found), limit, ones


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("snr", [20, 60])
def test_bar_d2_few(name, snr):
    found, _, good = one_record(name, snr, range(4))
    assert good == 4
    assert np.sqrt(np.mean(found**2)) < 1.4


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("snr", [10, 20, 30, 40, 50, 60])
def test_bar_d2_one_record(name, snr):
    found, limit, good = one_record(name, snr, range(50_000, 50_060))
    ratio = np.sqrt(np.mean(found**2, axis=0))
    print(f"D2 {name} {snr} dB: CRB of the phase {limit[0]:.3g}; RMSE/CRB phase {ratio[0]:.2f}, borders "
          f"{ratio[1:].min():.2f}-{ratio[1:].max():.2f}; converged {good}/60")  # fmt: skip
    assert good >= 58
    assert ratio[0] <= (1.7 if snr == 10 else 1.3)
    assert ratio[1:].max() <= (1.7 if snr == 10 else 1.4)


def joint(name, snr, seed):
    rng = np.random.default_rng(seed)
    swings = [swing(PLANTS[name], w, u, snr, rng.integers(1 << 60)) for w in OMEGA for u in AMPLITUDES]
    ones = [lump(linked_loop(s.mean, s.std, 3, s.omega, s.amplitude, s.drive)) for s in swings]
    found = joint_loops(swings, ones, 3)
    rising, falling = map(np.array, PLANTS[name])
    k = paper_scale(rising, falling)
    shape, omega = k ** np.arange(4), np.array(OMEGA)
    e = np.concatenate([
        found.gain * k / abs(g1(omega)) - 1, wrapped(found.phase - np.angle(g1(omega))),
        found.rising - rising * shape, found.falling - falling * shape,
    ])  # fmt: skip
    std = np.concatenate([found.gain_std * k / abs(g1(omega)), found.phase_std, found.rising_std, found.falling_std])
    return found, e, std


def test_bar_d3_one():
    found, e, std = joint("B2", 40, 7)
    assert np.abs(e / std).max() < 4.5
    assert abs(found.estimate.reduced_chi2 - 1) < 0.1  # 3053 degrees of freedom: four standard deviations
    assert found.resolved


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("snr", [20, 40, 60])
def test_bar_d3_joint(name, snr):
    runs = [joint(name, snr, seed) for seed in range(50_000, 50_060)]
    e, std = (np.array([run[i] for run in runs]) for i in (1, 2))
    chi2 = np.mean([run[0].estimate.reduced_chi2 for run in runs])
    ratio = np.sqrt(np.mean((e / std) ** 2, axis=0))
    rms = np.sqrt(np.mean(e**2, axis=0))
    print(f"D3 {name} {snr} dB: RMSE/CRB {ratio.min():.2f}-{ratio.max():.2f}, χ²/dof {chi2:.3f}; gains "
          f"{rms[:6].max():.2g}, phases {rms[6:12].max():.2g}, borders {rms[12:].max():.2g}")  # fmt: skip
    assert ratio.max() <= 1.3
    assert abs(chi2 - 1) <= 0.05
    assert all(run[0].resolved for run in runs)
    if snr == 40:
        assert rms[6:12].max() <= (3.5e-4 if name == "B1" else 2e-4)
        assert rms[:6].max() <= 3e-4
        assert rms[12:].max() <= 2.5e-4


def verdict(gap, seed, omega=1.0, curve=(0.0, 1.0, 0.0, 0.05)):
    borders = tuple((curve[0] + side * gap / 2, *curve[1:]) for side in (-1, 1))
    w = period(borders, omega, 1.0)
    y = np.tile(w, PERIODS + 1) + noise_std(w, 40) * np.random.default_rng(seed).normal(size=(PERIODS + 1) * M)
    return static_or_backlash(np.array([omega]), [1 + 0j], [harmonics(y, M, 1, 20)], 3)


def test_bar_d4_few():
    assert not any(verdict(0.0, seed).backlash for seed in range(4))
    assert all(verdict(0.01, seed).backlash for seed in range(4))


@pytest.mark.slow
def test_bar_d4_static_or_not():
    alarms = sum(verdict(0.0, seed).backlash for seed in range(50_000, 50_060))
    found = sum(verdict(0.01, seed).backlash for seed in range(50_000, 50_060))
    print(f"D4: {alarms} false alarms of 60 at 1e-4; gap .01 at 40 dB found {found} of 60")
    assert (alarms, found) == (0, 60)


def test_a_steep_static_curve_is_no_backlash():
    w = np.sign(np.cos(2 * np.pi * np.arange(M) / M - 0.4)) * 0.5 + period(B3, 1.0, 1.0)
    y = np.tile(w, 21) + 0.01 * np.random.default_rng(3).normal(size=21 * M)
    shifted = np.tile(np.tanh(5 * np.cos(2 * np.pi * np.arange(M) / M - 0.4)), 21)
    noisy = shifted + 0.01 * np.random.default_rng(3).normal(size=21 * M)
    assert static_or_backlash(np.ones(1), [1 + 0j], [harmonics(y, M, 1, 20)], 3).backlash  # two phases: no one curve
    assert not static_or_backlash(np.ones(1), [1 + 0j], [harmonics(noisy, M, 1, 20)], 3).backlash


def test_an_even_curve_is_ambiguous():
    y = np.tile(np.cos(2 * np.pi * np.arange(M) / M - 0.4) ** 2, 21) + 0.01 * np.random.default_rng(3).normal(size=21 * M)
    found = static_or_backlash(np.ones(1), [1 + 0j], [harmonics(y, M, 1, 20)], 3)
    assert found.ambiguous == (True,)
    assert not found.backlash


@pytest.mark.parametrize("name", PLANTS)
def test_the_papers_phase_is_early_and_separable_least_squares_is_not(name):
    """PAPERS has (23a) .11 and .41 off; where a stage begins in noise is a matter of reading, early it is in any."""
    swings = [swing(PLANTS[name], 1.0, 1.0, 40, seed) for seed in range(6)]
    phase = np.angle(g1(1.0))
    early = wrapped(2 * (constant_stages(swings, 3).phase - phase)) / 2
    assert early.min() > 0.05
    separable = separable_borders(swings, 3)
    off = wrapped(2 * (separable.phase - phase)) / 2
    assert np.abs(off).max() < 4 * 0.0036
    assert np.abs(off / separable.phase_std).max() < 4


def test_the_papers_errors_show_on_b2_and_hide_on_b1():
    """Noise-free: (37) as printed is .124 and more off on B2; corrected all is exact."""
    for name, borders in PLANTS.items():
        true = truth(borders, 1.0, 1.0)
        one = Lumped(1.0, 1.0, true[0], 1e-6, true[1:5], np.full(4, 1e-6), true[5:], np.full(4, 1e-6))
        k = paper_scale(*map(np.array, borders))
        expected = np.array(borders[1]) * k ** np.arange(4)
        for seen in (one, other_branch(one)):
            found = paper_borders([seen])
            np.testing.assert_allclose(found.falling[0], expected, atol=1e-12)
            np.testing.assert_allclose(found.gain[0] * k, abs(g1(1.0)), rtol=1e-12)
        printed = true[5:] * paper_scale(true[5:], true[5:]) ** np.arange(4)
        off = np.abs(printed - expected)[1:]
        assert off.max() < 1e-12 if name == "B1" else off.max() > 0.1


def test_borders_that_close_without_a_stage():
    """B5: f_a − f_d = c(x² − X²) at the sine's own amplitude."""
    x = 1.2
    rising, falling = np.array([-0.15 * x**2 / 2, 1.0, 0.075, 0.1]), np.array([0.15 * x**2 / 2, 1.0, -0.075, 0.1])
    size = x ** np.arange(4)
    theta = 2 * np.pi * np.arange(M) / M
    w, *_ = response(rising * size, falling * size, theta - 0.6, touch=1e-9)
    std, found = 0.002, []
    for seed in range(4):
        one = Swing(1.0, 1 + 0j, w + std * np.random.default_rng(seed).normal(size=M), np.full(M, std), PERIODS)
        for fit in (separable_borders([one], 3).row(0), lump(linked_loop(one.mean, one.std, 3))):
            e = np.concatenate([[fit.phase + 0.6], fit.rising - rising * size, fit.falling - falling * size])
            found.append(e / np.concatenate([[fit.phase_std], fit.rising_std, fit.falling_std]))
    assert np.abs(found).max() < 4.5
    noise = std * np.sqrt(PERIODS) * np.random.default_rng(9).normal(size=21 * M)
    assert static_or_backlash(np.ones(1), [1 + 0j], [harmonics(np.tile(w, 21) + noise, M, 1, 20)], 3).backlash


def test_the_dual_is_the_same_loop():
    rising, falling = map(np.array, B2)
    angle = 2 * np.pi * np.arange(50) / 50
    np.testing.assert_allclose(
        response(rising, falling, angle)[0], response(*dual(rising, falling), angle + np.pi)[0], atol=1e-14
    )
