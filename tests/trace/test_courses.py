"""Courses in time where no period repeats: they can follow anything, what the input does included."""

from dataclasses import replace

import numpy as np
import pytest

from whid.blocks.linear import Linear
from whid.disturbances.white import White
from whid.effects._look import Look, Noise
from whid.effects.drift import POINTS, Drift
from whid.record import Record
from whid.system import System
from whid.trace import Trace
from whid.trace._base import base
from whid.trace._round import one_round
from whid.trace._state import data_of

LAG = Linear(num=(1.0,), den=(3.0, 1.0))
DECLARED = System(chain=(LAG,), noise=(White(std=0.02),))
N = 3000


def record(seed, *, bent=0.0, drifting=0.0):
    """Return a lag's answer to noise whose size comes and goes, then a bent sensor, then one whose scale drifts."""
    rng = np.random.default_rng(seed)
    time = np.arange(N) / N
    u = (1 + 0.8 * np.sin(2 * np.pi * 1.5 * time)) * np.repeat(rng.standard_normal(N // 10), 10)
    x = LAG(u, 1.0, "zoh")
    y = (x - bent * x**3) * (1 + drifting * np.sin(2 * np.pi * 1.5 * time))
    return Record(u=u, y=y + 0.02 * rng.standard_normal(N), dt=1.0)


def ranked(seed, **plant):
    data = data_of(DECLARED, [record(seed, **plant)])
    here = base(DECLARED, data, "exact")
    return here, one_round(here, Trace(effects=("gain_drift",)).every(), data).ranking


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_scale_that_drifts_is_named(seed):
    assert ranked(seed, drifting=0.2)[1].taken == "gain_drift@output"


def test_what_the_input_does_is_not_followed_in_time():
    borne_out = 0
    for seed in (1, 2, 3):
        here, ranking = ranked(seed, bent=0.02)
        assert here.dirty
        assert ranking.gain[0] > ranking.needed  # it pays for its numbers
        assert ranking.taken == ""
        borne_out += ranking.selection[0] > 2 * ranking.selection_std[0]
    assert borne_out  # selection data lie in between and may well speak for it


def test_a_walk_costs_its_one_number():
    rng = np.random.default_rng(4)
    whole = record(4)
    walked = replace(whole, y=whole.y + np.cumsum(0.01 * rng.standard_normal(N)))
    look = Look(DECLARED, (walked,), (Noise(0.02),))
    start = Drift(place="output").screen(look)[0]
    assert len(start.candidate.new) == POINTS[-1]
    assert start.candidate.penalty(N) == pytest.approx(np.log(N) / 2)
    assert start.candidate.beyond > 0  # what goes on between two points
    carried = start.gain - start.candidate.beyond + start.candidate.penalty(N)
    change = look.along(start.candidate)
    left = look.left - change @ np.linalg.lstsq(change, look.left, rcond=1e-6)[0]
    assert carried == pytest.approx(N / 2 * np.log(look.chi2 / (left @ left)), rel=1e-6)
