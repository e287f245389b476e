"""What no effect does and yet is told: a heated gain, a hysteresis without a rate; and what is an effect's own."""

import numpy as np
import pytest

from whid.blocks.backlash import Backlash
from whid.blocks.delay import Delay
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.disturbances.white import White
from whid.effects._look import Look, Noise
from whid.effects.drift import Drift
from whid.record import Record
from whid.system import System
from whid.trace._base import base
from whid.trace._state import data_of
from whid.trace._unnamed import unnamed

LAG = Linear(num=(1.0,), den=(3.0, 1.0))
DECLARED = System(chain=(LAG,), noise=(White(std=0.02),))
N, STD = 4000, 0.02


def heated(x):
    """Return x with a gain that falls with its own past power: an Euler step a sample, its own code."""
    out, heat = np.empty(N), x[0] ** 2
    for n, now in enumerate(x):
        out[n] = now * (1 - 0.1 * heat)
        heat += (now**2 - heat) / 200
    return out


def many_plays(x):
    return x + sum(0.02 * (Backlash(gap=gap)(x, 1.0, "discrete") - x) for gap in np.linspace(0.2, 3.0, 12))


def late(x):
    return Delay(seconds=0.7)(x, 1.0, "zoh")


def described(seed, change):
    """Return the description of what the declared lag leaves over, and the nats that there are."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.standard_normal(N // 20), 20) * (1 + 0.8 * np.sin(2 * np.pi * np.arange(N) / 1700))
    y = change(LAG(u, 1.0, "zoh")) + STD * rng.standard_normal(N)
    look = base(DECLARED, data_of(DECLARED, [Record(u=u, y=y, dt=1.0)]), "exact").look
    look = Look(look.system, look.records, (Noise(STD),), look.core)
    return unnamed(look), look.samples / 2 * np.log(look.chi2 / look.samples)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (heated, "the gain follows the past power of the output, over about"),
        (many_plays, "a hysteresis behind the last block"),
    ],
)
def test_it_is_told_for_what_it_is(change, words):
    found, there = described(1, change)
    assert there > 100
    assert found.words.startswith(words)
    assert found.gain > 0.9 * there


def test_the_time_constant_is_told():
    assert 140 < float(described(2, heated)[0].words.split()[-2]) < 290  # 200, on a grid of steps of 1.5


def test_a_delay_is_none_of_these():
    found, there = described(3, late)
    assert found.gain < 0.5 * there


def test_nothing_is_told_of_noise():
    assert max(described(seed, np.array)[0].gain for seed in range(4, 14)) < 3


@pytest.mark.parametrize(("chain", "held"), [((LAG,), False), ((LAG, Polynomial(coefficients=(0.1, 1.0))), True)])
def test_a_course_has_no_level_that_the_model_has_already(chain, held):
    rng = np.random.default_rng(20)
    u = np.repeat(rng.standard_normal(N // 20), 20)
    system = System(chain=chain, noise=(White(std=STD),))
    look = Look(system, (Record(u=u, y=STD * rng.standard_normal(N), dt=1.0),), (Noise(STD),), (0, len(chain)))
    starts = [s.candidate.new for s in Drift(place="output").screen(look) if len(s.candidate.new) > 3]
    assert starts
    assert all(any(name.endswith("levels.0") for name in names) is not held for names in starts)
