"""What the raw output shows before any model, and what it must not show on records that are in order."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from whid.diagnostics.isolated import isolated
from whid.diagnostics.rails import rails
from whid.diagnostics.standing import frozen

N = 3000
ON = np.ones(N, bool)


def lag(u):
    return lfilter([0.3], [1, -0.7], u)


def staircase(levels=20):
    return np.repeat(np.append(np.arange(levels), np.arange(levels)[::-1]) / levels - 0.5, N // (2 * levels))[:N]


def square():
    return np.where(np.arange(N) % 100 < 50, 1.0, -1.0)


def three_levels():
    return np.repeat([0.0, 1.0, -1.0, 0.0, 1.0, -1.0], 50)[np.arange(N) % 300]


def sine():
    return np.sin(2 * np.pi * np.arange(N) / 100)


INPUTS = {
    "staircase": staircase, "square": square, "three levels": three_levels, "sine": sine,
    "prbs": lambda: np.sign(np.random.default_rng(1).standard_normal(N)),
    "noise": lambda: np.random.default_rng(2).standard_normal(N),
    "steps": lambda: np.repeat(np.random.default_rng(3).uniform(-1, 1, N // 20), 20),
    "multisine": lambda: np.sum([np.sin(2 * np.pi * k * np.arange(N) / 500 + k**2) for k in range(1, 30)], axis=0) / 5,
}  # fmt: skip
PLANTS = {
    "static": lambda u: u, "bent": lambda u: u + 0.3 * u**2, "lag": lag, "dead zone": lambda u: u - np.clip(u, -0.3, 0.3),
    "dead zone, lag": lambda u: lag(u - np.clip(u, -0.3, 0.3)), "resonance": lambda u: lfilter([0.3], [1, -1.6, 0.9], u),
}  # fmt: skip
NOISES = {"none": 0.0, "noise": 0.02}
STEPS = {"exact": 0.0, "fine": 0.005, "coarse": 0.05}


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS)
@pytest.mark.parametrize("std", NOISES.values(), ids=NOISES)
@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
@pytest.mark.parametrize("drive", INPUTS.values(), ids=INPUTS)
def test_a_record_in_order_raises_no_alarm(drive, plant, std, step):
    u = drive()
    y = plant(u) + std * np.random.default_rng(4).standard_normal(N)
    y = step * np.round(y / step) if step else y
    assert rails(y, u, ON) == (None, None)
    assert not frozen(y, u, ON).any()
    assert not isolated(y, u, ON).any()


def spoilt(seed, step=0.0):
    rng = np.random.default_rng(seed)
    u = INPUTS["multisine"]()
    y = lag(u) + 0.02 * rng.standard_normal(N)
    return u, step * np.round(y / step) if step else y, rng


@pytest.mark.parametrize("step", [0.0, 0.0005], ids=["exact", "on a lattice"])
@pytest.mark.parametrize("seed", range(5))
def test_rails_are_found_to_the_last_digit(seed, step):
    u, y, _ = spoilt(seed, step)
    high = 0.8 * np.ptp(y) + y.min()
    low, found = rails(np.minimum(y, high), u, ON)
    assert low is None
    assert found.level == high
    assert (found.at == (y >= high)).all()
    assert found.nats > 100


@pytest.mark.parametrize("seed", range(5))
def test_a_sensor_that_hangs_is_found_where_it_does(seed):
    u, y, rng = spoilt(seed)
    at = rng.choice(np.arange(20, N - 20, 20), 12, replace=False)
    for k in at:
        y[k + 1 : k + 1 + rng.integers(2, 6)] = y[k]
    truth = np.append(False, np.diff(y) == 0)
    assert (frozen(y, u, ON) == truth).all()


@pytest.mark.parametrize("seed", range(5))
def test_wild_samples_are_found(seed):
    u, y, rng = spoilt(seed)
    at = rng.choice(np.arange(20, N - 20, 20), 8, replace=False)
    y[at] += rng.choice([-1.0, 1.0], 8)
    assert (np.flatnonzero(isolated(y, u, ON)) == np.sort(at)).all()
