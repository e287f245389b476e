"""A wrong assumption about the input between its samples is reported as that."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.trace_plants import PLANT, believed, excitation, measured
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
