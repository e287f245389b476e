"""Bar A2: 95 % intervals of the levels of design P cover, in white and in coloured noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.design_p import PLANT, STD, clean
from whid.errors import WhidError
from whid.stages.levels import level_means
from whid.stages.settle import settle_time

F = PLANT.chain[1]


def coverage(rho, seeds, settle=None):
    """Which intervals hold the true level, (seeds, levels); settle from the data unless given."""
    record = clean()
    parts = list(record.select("hold"))
    level, stop = np.array([part.level for part in parts]), parts[-1].stop
    inside = []
    for seed in range(seeds):
        white = np.random.default_rng(7000 + seed).normal(size=stop + 200)
        y = record.y[:stop] + STD * lfilter([np.sqrt(1 - rho**2)], [1, -rho], white)[200:]
        holds = [y[part.start : part.stop] for part in parts]
        curve = level_means(holds, level, np.ones(16), record.dt, settle or settle_time(holds, record.dt).settle)
        inside.append(np.abs(curve.mean - F.value(level)) < 1.96 * curve.mean_std)
    return np.array(inside)


@pytest.mark.parametrize("rho", [0.0, 0.9])
@pytest.mark.parametrize("settle", [None, 120.0], ids=["settle from the data", "settle 120 s"])
def test_a2(rho, settle):
    """200 seeds take 2 s, so the bar runs at its own count."""
    inside = coverage(rho, 200, settle)
    print(f"A2 rho {rho}, settle {settle}: pooled coverage {inside.mean():.4f}, worst level {inside.mean(axis=0).min():.3f}")
    assert 0.92 <= inside.mean() <= 0.97
    assert inside.mean(axis=0).min() >= 0.88


def test_white_noise_formula():
    """In white noise the error of a mean is σ/√n."""
    holds = list(np.random.default_rng(0).normal(size=(20, 1000)))
    curve = level_means(holds, np.arange(20.0), np.ones(20), 1.0, 100.0)
    assert np.all(curve.samples == 900)
    assert curve.mean_std == pytest.approx(np.full(20, 1 / 30), rel=4 / np.sqrt(2 * 18000))
    assert curve.mean == pytest.approx([hold[100:].mean() for hold in holds])
    assert "white" in curve.table().notes[0]


def test_missing_samples_widen_the_error():
    whole = np.random.default_rng(1).normal(size=(10, 800))
    holed = whole.copy()
    holed[3, ::2] = np.nan
    curve = level_means(list(holed), np.arange(10.0), np.ones(10), 1.0, 0.0)
    assert curve.samples[3] == 400
    assert curve.mean_std[3] / curve.mean_std[0] == pytest.approx(np.sqrt(2), rel=1e-6)


def test_a_hold_without_settled_samples_is_dropped_and_none_left_is_an_error():
    holds = [np.zeros(100) + np.random.default_rng(2).normal(size=100), np.zeros(5)]
    assert level_means(holds, np.array([1.0, 2.0]), np.ones(2), 1.0, 10.0).level.tolist() == [1.0]
    with pytest.raises(WhidError, match="settling time of 200 s"):
        level_means(holds, np.array([1.0, 2.0]), np.ones(2), 1.0, 200.0)


def test_coarse_quantisation_keeps_its_error():
    """Without dither the mean is off by up to half a step: std step/√12, however many samples."""
    steady = np.repeat([[0.3], [1.1], [1.9], [2.45]], 500, axis=1)
    curve = level_means(list(np.round(steady)), np.arange(4.0), np.ones(4), 1.0, 0.0)
    assert curve.quantum == 1
    assert curve.mean_std == pytest.approx(np.full(4, 1 / np.sqrt(12)), rel=0.01)
    assert np.all(np.abs(curve.mean - steady[:, 0]) < 2 * curve.mean_std)


def test_a_drift_goes_into_the_error():
    drift = np.linspace(-1, 1, 400)
    holds = list(drift + 0.1 * np.random.default_rng(3).normal(size=(6, 400)))
    curve = level_means(holds, np.arange(6.0), np.ones(6), 1.0, 0.0)
    assert curve.drifting.all()
    assert np.all(curve.mean_std > 0.9)
    steady = [
        level_means(list(np.random.default_rng(s).normal(size=(6, 400))), np.arange(6.0), np.ones(6), 1.0, 0.0)
        for s in range(200)
    ]
    assert sum(c.drifting.any() for c in steady) <= 2


def test_levels_with_noise_of_their_own():
    std = np.array([0.01, 1.0, 1.0, 1.0])
    holds = list(std[:, None] * np.random.default_rng(4).normal(size=(4, 900)))
    curve = level_means(holds, np.arange(4.0), np.ones(4), 1.0, 0.0)
    assert not curve.equal_noise
    assert curve.mean_std == pytest.approx(std / 30, rel=0.15)
