"""The noise that repeated periods show, and what of it is chance."""

import numpy as np
import pytest
from scipy.signal import lfilter

from whid.effects._candidate import CHANCE, Candidate
from whid.experiments.multisine import Multisine
from whid.record import Record
from whid.system import System
from whid.trace._floor import floor

PERIOD, PERIODS = 200, 7


def record(rng, *, ar=(), ringing=0.0):
    wave = np.cumsum(rng.standard_normal(PERIOD))
    white = 0.3 * rng.standard_normal(PERIOD * PERIODS + 500)
    noise = lfilter([1.0], [1.0, *(-a for a in ar)], white)[500:]
    y = np.tile(wave, PERIODS) + noise + ringing * np.exp(-np.arange(PERIOD * PERIODS) / 12)
    part = Multisine(start=0, stop=len(y), period=PERIOD)
    return Record(np.tile(wave, PERIODS), y, 0.1, parts=(part,))


@pytest.mark.parametrize("ringing", [0.0, 1.0, 20.0])
def test_what_rings_on_into_the_first_period_is_no_noise(ringing):
    found = floor([record(np.random.default_rng(4), ringing=ringing)], coloured=False)
    assert found.std == pytest.approx(0.3, rel=4 / np.sqrt(2 * PERIOD * (PERIODS - 2)))
    assert found.dof >= PERIOD * (PERIODS - 2)


def test_the_innovation_of_coloured_noise_is_less_than_the_noise():
    found = floor([record(np.random.default_rng(5), ar=(0.7,))], coloured=True)
    assert found.innovation == pytest.approx(0.3, rel=5 / np.sqrt(2 * PERIOD * (PERIODS - 1)))
    assert found.std == pytest.approx(0.3 / np.sqrt(1 - 0.7**2), rel=0.15)


@pytest.mark.parametrize(("tried", "of"), [(1, 40), (30, 40), (500, 3)])
def test_two_numbers_gain_by_chance_what_an_exponential_says(tried, of):
    """χ² with two degrees of freedom: P(gain > x nats) = e^−x."""
    candidate = Candidate(System(chain=()), (0, 0), ("one", "two"), tried=tried)
    nats = candidate.chance(6000, of) + candidate.penalty(6000)
    assert of * tried * np.exp(-nats) == pytest.approx(CHANCE, rel=1e-9)
