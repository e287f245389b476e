"""Bar A8: size of the harmonic-floor test, and its power when the inner sine grazes a jump."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.design_p import PLANT, STD
from whid.blocks.chain import Chain
from whid.signal import held
from whid.stages.harmonic_floor import harmonic_floor
from whid.stages.periods import harmonics

DT = np.pi / 6


def rejected(runs, rho=0.0, periods=20, samples=600):
    """The share of memory-free parabolas called broken."""
    n = np.arange(samples * (periods + 1))
    clean = 100 + 30 * np.cos(2 * np.pi * n / samples) + 9 * np.cos(4 * np.pi * n / samples - 1)
    count = 0
    for seed in range(runs):
        white = np.random.default_rng([8, seed]).standard_normal(len(n))
        noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], white) if rho else white
        count += not harmonic_floor(harmonics(clean + STD * noise, samples, 1), 2).passed
    return count / runs


def grazing(over, samples, offset=1.9):
    """Output when the inner sine passes the −5 jump at 0.8 by `over`, the amplitude set by the front's peak."""
    u = np.cos(2 * np.pi * np.arange(21 * samples) / samples)
    inner = PLANT.chain[0].step(held(u, DT, "zoh"))[0]
    amplitude = (offset - 0.8 + over) / -inner.panels.values[:, -2 * samples :].min()
    return Chain(chain=PLANT.chain).step(held(offset + amplitude * u, DT, "zoh"))[0].values


def power(over, samples, runs):
    y = grazing(over, samples)
    noisy = (y + STD * np.random.default_rng([88, seed]).standard_normal(len(y)) for seed in range(runs))
    return np.mean([not harmonic_floor(harmonics(e, samples, 1), 2).passed for e in noisy])


def test_a8_size_reduced():
    """1500 runs, the bar's interval widened by 3 binomial deviations."""
    size = rejected(1500)
    print(f"A8 size {size:.4f} over 1500 runs, nominal .01")
    assert size == pytest.approx(0.01, abs=0.004 + 3 * np.sqrt(0.0099 / 1500))


@pytest.mark.slow
@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_a8_size(rho):
    size = rejected(10_000, rho)
    print(f"A8 size {size:.4f} over 10 000 runs, rho {rho}, nominal .01")
    assert 0.006 <= size <= 0.014


@pytest.mark.parametrize("periods", [3, 5, 40])
def test_size_with_few_and_many_periods(periods):
    """The noise estimate's own scatter is part of the test: 4 lines behind each order are enough."""
    size = rejected(1500, periods=periods, samples=100)
    assert size == pytest.approx(0.01, abs=3 * np.sqrt(0.0099 / 1500))


def test_a8_power():
    """ω = .02: a jump of 5 passed by 1e-4 is always seen; one not reached is noise; at .04 and .06 the dip is shorter."""
    hit, miss = power(1e-4, 600, 100), power(-1e-4, 600, 100)
    deeper = {samples: power(1e-3, samples, 40) for samples in (300, 200)}
    print(f"A8 power {hit:.3f} at ω .02 for 1e-4 over, {miss:.3f} for 1e-4 short; for 1e-3 over at .04, .06: {deeper}")
    assert hit == 1
    assert miss <= 0.05
    assert deeper == {300: 1.0, 200: 1.0}


@pytest.mark.slow
def test_power_at_every_frequency():
    """The power falls with the dip's length: the noncentrality is 334, 71, 25 on 36 degrees of freedom."""
    for samples, least in ((600, 1.0), (300, 0.97), (200, 0.3)):
        found = power(1e-4, samples, 300)
        print(f"A8 power {found:.3f} at {samples} samples a period for 1e-4 over")
        assert found >= least


def test_degree_too_low_names_its_order():
    n = np.arange(2100)
    y = np.cos(2 * np.pi * n / 100) + 0.2 * np.cos(6 * np.pi * n / 100) + 0.1 * np.random.default_rng(1).normal(size=2100)
    found = harmonic_floor(harmonics(y, 100), 2)
    assert not found.passed
    assert found.worst == 3
    assert found.orders.tolist() == list(range(3, 21))
    assert "left" in found.table().notes[0]


def test_nothing_to_test():
    y = np.cos(2 * np.pi * np.arange(500) / 100)
    for found in (harmonic_floor(harmonics(y, 100), 20), harmonic_floor(harmonics(y[:200], 100), 1)):
        assert found.passed
        assert found.dof == 0
        assert found.table().rows == ()


def test_noise_free_harmonics_pass():
    assert harmonic_floor(harmonics(grazing(-1e-2, 600), 600, 2), 2).passed
