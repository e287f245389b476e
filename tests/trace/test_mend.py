"""A jump that nothing smooths: the fit steps across it, where slopes lead nowhere."""

from __future__ import annotations

import pytest

from tests.trace_plants import PLANT, STD, believed, measured
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.effects._look import Look, Noise
from whid.system import System
from whid.trace._mend import across, tried
from whid.trace._refit import error2, fitted

JUMP = System(
    chain=(
        Linear(num=(1.0,), den=(0.3, 0.8, 1.0), fix=("num.0", "den.2")),
        Piecewise(breaks=(-0.5,), pieces=((1.4, 0.9), (2.3, 0.1))),
    )
)


def look_at(system, seed):
    return Look(believed(system, seed), (measured(system, seed).without("report"),), (Noise(STD),), (0, len(system.chain)))


@pytest.mark.parametrize("seed", [71, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (72, 73))])
def test_samples_on_the_wrong_side_of_a_jump_come_right(seed):
    stuck, _ = fitted(look_at(JUMP, seed))
    look, estimate = tried(across, stuck)
    assert error2(stuck) > 1.5 * stuck.use[0].sum()
    assert error2(look) < 1.15 * look.use[0].sum()  # one sample on the wrong side alone would add .5
    here = dict(zip(estimate.names, estimate.values.tolist(), strict=True))
    assert here["chain.1.breaks.0"] == pytest.approx(-0.5, abs=0.01)


def test_without_a_bare_jump_there_is_nothing_to_step_across():
    assert across(look_at(PLANT, 74)) is None
    behind = System(chain=(*JUMP.chain, Linear(num=(1.0,), den=(0.3, 1.0))))
    assert across(look_at(behind, 75)) is None
