"""Settling time from the data: known transients, coloured noise, holds that are too short."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.design_p import PLANT, clean
from whid.errors import WhidError
from whid.stages.settle import settle_time


def holds_of(record):
    return [record.y[part.start : part.stop] for part in record.select("hold")]


def transients(tau, size, samples, count, seed, std=1.0, rho=0.0):
    noise = np.random.default_rng(seed).normal(size=(count, samples))
    sign = (-1.0) ** np.arange(count)[:, None]
    return list(std * lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise) + sign * size * np.exp(-np.arange(samples) / tau))


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_the_rest_of_the_transient_is_below_the_noise(rho):
    """After the settling time the bias of a hold's mean is below half its standard error."""
    for seed in range(20):
        found = settle_time(transients(20, 50, 500, 10, seed, rho=rho), 0.1)
        first = round(found.settle / 0.1)
        bias = 50 * np.exp(-np.arange(first, 500) / 20).mean()
        error = np.sqrt((1 + rho) / (1 - rho) / (500 - first))
        assert found.reached
        assert bias < error / 2
        assert first < 300


def test_nothing_to_settle():
    found = [settle_time(transients(1, 0, 200, 10, seed), 1.0) for seed in range(100)]
    assert sum(f.truncation == 0 for f in found) >= 95  # nominal 99


@pytest.mark.parametrize(("hold_s", "reached"), [(20, False), (40, False), (60, False), (150, True), (200, True)])
def test_short_holds_of_design_p_are_said_to_be_too_short(hold_s, reached):
    """The slowest pole is 0.1 rad/s: in 60 s, a second half still holds a visible drift."""
    from whid.blocks.chain import Chain
    from whid.signal import held

    dt, levels = np.pi / 6, np.arange(-3.5, 4.1, 0.5)
    samples = round(hold_s / dt)
    signal = held(np.repeat(levels, samples), dt, "zoh")
    y = Chain(chain=PLANT.chain).step(signal)[0].values
    y = y + 0.5 * np.random.default_rng(11).normal(size=len(y))
    assert settle_time(list(y.reshape(16, -1)), dt).reached is reached


def test_design_p_settles_near_its_optimum():
    """The least mean square error of the levels is at 72-74 s."""
    dt = clean().dt
    settle = []
    for seed in range(20):
        noise = 0.5 * np.random.default_rng(seed).normal(size=len(clean().y))
        holds = [hold + e for hold, e in zip(holds_of(clean()), np.split(noise[: 16 * 382], 16), strict=True)]
        settle.append(settle_time(holds, dt).settle)
    print(f"settle: median {np.median(settle):.1f} s, {min(settle):.1f} to {max(settle):.1f} s")
    assert 72 < np.median(settle) < 110


@pytest.mark.parametrize(
    ("size", "constants", "reached"), [(20, 5, False), (120, 5, False), (120, 7.5, False), (20, 10, True), (120, 10, True)]
)
def test_what_is_left_of_an_exponential_is_foretold(size, constants, reached):
    """By the mean of the last quarter, against its own standard error: half of that is as good as settled."""
    samples = int(30 * constants)
    kept = samples - int(np.ceil(0.75 * samples))
    bias = size * np.exp(-np.arange(samples - kept, samples) / 30).mean() * np.sqrt(kept)  # standard errors
    rho = np.exp(-constants / 4)
    std = (2 * rho / (1 - rho) + (rho / (1 - rho)) ** 2) * np.sqrt(2 / 11)  # of ρ²/(1 − ρ), 11 holds
    for seed in range(600, 610):
        found = settle_time(transients(30, size, samples, 11, seed), 1.0)
        assert found.reached is reached
        if not found.reached:
            assert abs(found.bias_ratio - bias) < 4 * std + 0.15 * bias  # the noise's own size is known to some 10 %


def test_missing_samples_and_unequal_lengths():
    holds = transients(20, 50, 500, 10, 0)
    rng = np.random.default_rng(1)
    holds = [np.where(rng.random(500) < 0.2, np.nan, hold)[: 500 - 20 * k] for k, hold in enumerate(holds)]
    found = settle_time([*holds, np.zeros(3)], 0.1)
    assert found.reached
    assert 8 < found.settle < 25
    assert "settle s" in found.table().columns


def test_no_usable_hold():
    with pytest.raises(WhidError, match="16 samples"):
        settle_time([np.zeros(5)], 1.0)


def test_a_drift_that_swings_is_not_settled_where_it_crosses_zero():
    """Behind a complex pair of poles first quarter and last half agree by chance long before the drift is over."""
    t = 0.05 * np.arange(500)
    swing = np.exp(-0.5 * t) * np.cos(1.3 * t)
    rng = np.random.default_rng(20600)
    for _ in range(20):
        holds = [3.0 * way * swing + 0.03 * rng.standard_normal(500) for way in (1, -1) * 10]
        settle = settle_time(holds, 0.05).settle
        bias = 3.0 * abs(swing[round(settle / 0.05) :].mean())
        assert bias < 0.5 * 0.03 / np.sqrt(500 - settle / 0.05), settle
