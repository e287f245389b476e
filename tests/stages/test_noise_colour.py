"""The test of white noise: its size, what it finds, and the factor that it tells, against closed forms and scatter."""

import numpy as np
import pytest
from scipy.signal import lfilter

from whid.stages.noise_colour import noise_colour


def ar(rho, size, seed):
    return lfilter([1.0], [1.0, -rho], np.random.default_rng(seed).normal(size=size + 500))[500:]


def test_size_is_the_nominal_one():
    """χ² of p over 2000 white records, in tenths; the lowest percentile by a binomial interval."""
    p = np.array([noise_colour([np.random.default_rng([77, k]).normal(size=400)]).p for k in range(2000)])
    assert 0.003 < np.mean(p < 0.01) < 0.02
    counts = np.histogram(p, 10, (0, 1))[0]
    assert np.sum((counts - 200) ** 2 / 200) < 33.7  # χ²(9) at 1e-4


def test_a_period_average_that_was_taken_out_does_not_colour_it():
    p = []
    for k in range(600):
        y = np.random.default_rng([78, k]).normal(size=(3, 128))
        p.append(noise_colour([(y - y.mean(axis=0)).ravel()], lost=[1 / 3]).p)
    assert 0.0 <= np.mean(np.array(p) < 0.01) < 0.03
    assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("rho", [0.3, 0.9, -0.5])
def test_the_factor_of_a_mean_is_that_of_its_scatter(rho):
    found = noise_colour([ar(rho, 40_000, 5)])
    assert not found.white
    assert found.correlation == pytest.approx(rho, abs=0.02)
    assert found.factor == pytest.approx(np.sqrt((1 + rho) / (1 - rho)), rel=0.15)  # lim n·var(mean)/var, of an AR(1)
    assert found.doubts()[0].startswith("coloured noise")
    assert ("too small" in found.doubts()[0]) == (rho > 0)


def test_the_factor_hangs_on_what_is_estimated():
    """A slope on a regressor: white, colour does nothing to it; as coloured as the noise, (1 + ρ²)/(1 − ρ²)."""
    noise, white, alike = ar(0.8, 60_000, 6), np.random.default_rng(7).normal(size=60_000), ar(0.8, 60_000, 8)
    assert noise_colour([noise], [white]).factor == pytest.approx(1.0, abs=0.1)
    assert noise_colour([noise], [alike]).factor == pytest.approx(np.sqrt(1.64 / 0.36), rel=0.15)
    slopes = [ar(0.8, 2000, [9, k]) @ (x := ar(0.8, 2000, [10, k])) / (x @ x) for k in range(400)]
    assert np.std(slopes) * np.sqrt(2000) == pytest.approx(np.sqrt(1.64 / 0.36), rel=0.15)


def test_nothing_left_over_is_not_tested():
    for stretches in ([], [np.zeros(500)], [np.ones(7)]):
        found = noise_colour(stretches)
        assert found.white
        assert found.lags == 0
        assert found.doubts() == ()
