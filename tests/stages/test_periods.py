"""Period averages, harmonics with their errors in coloured noise, non-integer periods, missing samples, the sine fit."""

import numpy as np
import pytest
from scipy.signal import lfilter

from whid.errors import WhidError
from whid.stages.periods import fit_sine, harmonics, period_average

VALUE = np.array([10, 5 - 3j, 1 + 2j, -0.3j, 0.2])


def wave(n, period, value=VALUE):
    return np.real(np.exp(2j * np.pi * np.outer(n / period, np.arange(len(value)))) @ value)


@pytest.mark.parametrize("period", [200, 200.25, 37.7, 600])
@pytest.mark.parametrize("skip", [0, 1, 2])
def test_exact_without_noise(period, skip):
    """Phases refer to the first sample of the part whatever the lead and whatever the period."""
    y = wave(np.arange(int(12.3 * period)), period)
    found = harmonics(y, period, skip, count=6)
    assert found.value[:5] == pytest.approx(VALUE, abs=1e-9)
    assert np.abs(found.value[5:]).max() < 1e-9
    average = period_average(y, period, skip)
    assert average.mean == pytest.approx(wave(average.phase, period), abs=1e-8)
    assert average.periods == found.periods == int(12.3 * period + 0.5 - skip * period) // period


def test_folding_at_the_wrong_period_is_wrong():
    """200.25 samples a period folded as 200: every period starts 2π·.25/200.25 earlier, 11 periods on the average."""
    y = wave(np.arange(21 * 201), 200.25, np.array([0, 1.0]))
    drift = 2 * np.pi * 0.25 / 200.25
    assert np.angle(harmonics(y, 200, 1).value[1]) == pytest.approx(-11 * drift, abs=0.5 * drift)
    assert abs(np.angle(harmonics(y, 200.25, 1).value[1])) < 1e-9


def test_missing_samples():
    rng = np.random.default_rng(3)
    n = np.arange(21 * 600)
    y = wave(n, 600) + 0.5 * rng.normal(size=len(n))
    y[rng.random(len(n)) < 0.25] = np.nan
    y[3000:3300] = np.nan
    found = harmonics(y, 600, 1)
    truth = np.pad(VALUE, (0, 16))
    z = np.concatenate([(found.value - truth).real / found.value_std, (found.value - truth).imag[1:] / found.value_std[1:]])
    assert np.abs(z).max() < 4.5
    average = period_average(y, 600, 1)
    assert np.std((average.mean - wave(average.phase, 600)) / average.mean_std) == pytest.approx(1, abs=0.12)


def coverage(rho, period, runs):
    """How often ±1.96 std holds each component, and how often the white-noise formula does."""
    n = np.arange(int(21 * period))
    clean, truth = wave(n, period), np.pad(VALUE, (0, 16))
    inside, naive = np.zeros((2, 21)), np.zeros((2, 21))
    for seed in range(runs):
        white = np.random.default_rng(50_000 + seed).normal(size=len(n) + 200)
        found = harmonics(clean + 0.5 * lfilter([np.sqrt(1 - rho**2)], [1, -rho], white)[200:], period, 1)
        error = np.abs([(found.value - truth).real, (found.value - truth).imag])
        inside += error < 1.96 * found.value_std
        naive += error < 1.96 * 0.5 * np.sqrt(2 / (20 * period))
    return inside[:, 1:].mean() / runs, naive[:, 1:4].mean() / runs


@pytest.mark.parametrize("rho", [0.0, 0.9])
@pytest.mark.parametrize("period", [600, 200.25])
def test_errors_are_honest_in_coloured_noise(rho, period):
    runs = 300 if period == 600 else 60
    inside, naive = coverage(rho, period, runs)
    print(f"harmonics, rho {rho}, period {period}: coverage {inside:.3f}, white-noise formula {naive:.3f} at orders 1-3")
    assert inside == pytest.approx(0.942, abs=0.015)  # Student's t of 36 degrees of freedom at 1.96 is .942
    assert (naive < 0.45) == (rho == 0.9)


def test_noise_figures():
    n = np.arange(21 * 300)
    found = harmonics(wave(n, 300) + 0.5 * np.random.default_rng(8).normal(size=len(n)), 300, 1)
    assert found.noise_std == pytest.approx(0.5, rel=4 / np.sqrt(2 * 6000))
    assert found.value_std[1:].mean() == pytest.approx(0.5 * np.sqrt(2 / 6000), rel=0.15)
    assert found.own_lines == 18
    average = period_average(wave(n, 300) + 0.5 * np.random.default_rng(8).normal(size=len(n)), 300, 1)
    assert average.noise_std == pytest.approx(0.5, rel=4 / np.sqrt(2 * 5700))
    assert average.mean_std == pytest.approx(np.full(300, average.noise_std / np.sqrt(20)))
    assert [row[0] for row in found.table().rows] == [0, 1, 2, 3, 4]
    assert average.table().rows[0][1] == 20


def test_few_periods_and_few_samples():
    y = wave(np.arange(250), 100)
    one = harmonics(y, 100, 1)
    assert np.isinf(one.value_std).all()
    assert one.value[:5] == pytest.approx(VALUE, abs=1e-9)
    assert np.isfinite(harmonics(y, 100, 0).value_std).all()
    assert harmonics(y, 9, 0).order[-1] == 4  # below half the samples a period
    for period, skip in [(100, 2), (2, 0), (300, 0)]:
        with pytest.raises(WhidError):
            harmonics(y, period, skip)


@pytest.mark.parametrize("guess", [198, 200, 203])
def test_sine_fit(guess):
    """Errors of all four numbers over 40 seeds, with quantised, holed data."""
    n = np.arange(4000)
    truth = np.array([2.0, 0.5, 0.3, 200.25])
    z = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u = truth[0] + truth[1] * np.cos(2 * np.pi * n / truth[3] + truth[2]) + 0.05 * rng.normal(size=4000)
        u = np.round(u / 0.01) * 0.01
        u[rng.random(4000) < 0.1] = np.nan
        found = fit_sine(u, guess)
        z.append((np.array(found[:4]) - truth) / np.array(found[4:8]))
    assert np.abs(np.mean(z, axis=0)).max() < 4 / np.sqrt(40)
    assert np.std(z, axis=0) == pytest.approx(np.ones(4), abs=0.45)
    assert found.noise_std == pytest.approx(np.hypot(0.05, 0.01 / np.sqrt(12)), rel=0.06)
    assert len(found.table().rows[0]) == 4


@pytest.mark.parametrize(("periods", "rho"), [(3, 0.0), (3, 0.9), (5, -0.5)])
def test_intervals_cover_with_few_periods_and_coloured_noise(periods, rho):
    """1500 runs: a 95 % interval from 16 lines covers .93 to .95; from the P − 1 lines of 3 periods it would cover .85."""
    rng = np.random.default_rng(20500)
    z = []
    for _ in range(1500):
        e = lfilter([1.0], [1.0, -rho], rng.standard_normal(300 + 100 * (periods + 1)))[300:]
        found = harmonics(e, 100, skip=1, count=20, ar=np.array([rho]))
        z.append((found.value / found.value_std)[:4].real)
    cover = np.mean(np.abs(z) < 1.96, axis=0)
    assert np.all((cover > 0.93 - 3 * 0.0066) & (cover < 0.95 + 3 * 0.0056)), cover
