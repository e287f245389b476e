"""A wrong assumption about the input between its samples is reported as that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.trace_plants import PLANT, believed, excitation, measured
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.config.yaml import dump
from whid.effects._effect import Effect
from whid.effects._look import Look, Noise
from whid.effects._sites import Sites
from whid.kinds import plain
from whid.predict import predict
from whid.system import System
from whid.trace import Trace, trace

EFFECTS = ("intersample", "delay", "lag", "resonance", "curve", "saturation")


@pytest.mark.parametrize("declared", ["zoh", pytest.param("foh", marks=pytest.mark.slow)])
def test_a_mismatch_is_reported_before_any_effect(declared):
    true = {"zoh": "foh", "foh": "zoh"}[declared]
    record = measured(PLANT, 51, plan=replace(excitation(51, 256, 3), intersample=true))
    verdict = list(trace(believed(PLANT, 51), [replace(record, intersample=declared)], Trace(effects=EFFECTS)))[-2]
    assert verdict.verdict == "explained"
    assert [effect.name for effect in verdict.effects] == ["intersample@time"]
    assert verdict.sentence == "explained: intersample@time"


def test_filters_around_a_curve_may_run_at_twice_the_rate():
    """The curve's third harmonic folds back in a model at the record's rate; the study of the faster one can be written."""
    dt = 0.1
    slow = System(
        chain=(
            Linear(num=(0.4, 0.3), den=(1.0, -0.3), dt=dt),
            Polynomial(coefficients=(0.0, 1.0, 0.0, -0.3)),
            Linear(num=(0.5, 0.2), den=(1.0, -0.4), dt=dt),
        )
    )
    plan = replace(excitation(52, 256, 3), intersample="bandlimited")
    look = Look(slow, (replace(plan, y=predict(slow.tree, plan)),), (Noise(0.02),), (0, 3))
    effect = Effect.named("intersample")(place="time")
    (faster,) = effect.candidates(look, Sites(slow, (0, 3)))
    kinds = [block.kind for block in faster.system.series]
    assert kinds == ["linear", "polynomial", "linear"]
    assert "factor: 2" in dump(plain(faster.system))
    for name in Effect.kinds():  # every other effect finds its place in it, or says that it has none
        for place in Effect.named(name).places:
            Effect.named(name)(place=place).screen(look.moved(faster.system))
    change = np.abs(predict(faster.system.tree, plan) - predict(slow.tree, plan))
    assert 0 < np.median(change) < 0.1  # the same filters, but for what folds back
    assert look.moved(faster.system).signal(1)[0].shape == plan.u.shape
