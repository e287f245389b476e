"""The base fit: where an effect only moved the declared numbers on, the declared model is fitted again."""

import numpy as np

from whid.blocks.linear import Linear
from whid.disturbances.white import White
from whid.effects._look import Look, Noise
from whid.effects.delay import Delay
from whid.record import Record
from whid.system import System
from whid.trace._base import better
from whid.trace._gate import gate
from whid.trace._refit import error2, fitted, refit
from whid.trace._state import State

LAG = Linear(num=(1.0,), den=(3.0, 1.0))
STD = 0.02


def state(lag):
    """Return a declared lag as it stands, before a record of the true one."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.standard_normal(150), 20)
    record = Record(u=u, y=LAG(u, 1.0, "zoh") + STD * rng.standard_normal(len(u)), dt=1.0)
    look = Look(System(chain=(lag,), noise=(White(std=STD),)), (record,), (Noise(STD),), (0, 1))
    return State(look, fitted(look, 0)[1], gate(look))


def with_an_effect(first):
    effect = Delay(place="time")
    return refit(first.look, effect.screen(first.look)[:1])


def test_a_fit_that_stopped_at_a_wrong_place_goes_on():
    first = state(Linear(num=(0.7,), den=(5.0, 1.0)))
    found = better(first, with_an_effect(first))
    assert error2(first.look) > 10 * first.look.samples
    assert error2(found.look) < 1.1 * first.look.samples
    assert abs(found.look.system.series[0].den[0] - 3.0) < 0.1


def test_a_fit_at_its_minimum_stays():
    first = state(LAG)
    look, estimate = fitted(first.look)
    first = State(look, estimate, gate(look))
    assert better(first, with_an_effect(first)) is None
