"""What every effect promises: it finds its own mechanism, keeps quiet on clean noise, says how well it knows its number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.effects.examples import EXAMPLES, Example
from tests.trace_plants import DT, STD, believed, excitation
from whid.effects._effect import Effect
from whid.effects._look import Look, Noise
from whid.predict import predict
from whid.trace._refit import fitted, refit

CASES = [
    pytest.param(example, id=name, marks=[pytest.mark.slow] if name.startswith("feedback") else [])  # a quarter of a minute
    for name, example in EXAMPLES.items()
]
ALL = [f"{kind}@{place}" for kind in Effect.kinds() for place in Effect.named(kind).places]


def look(example: Example, seed: int, hidden: bool = True) -> Look:
    plan = excitation(seed, 256, 3)
    y = predict((example.truth if hidden else example.declared).tree, plan)
    y = y + STD * np.random.default_rng(seed + 1).standard_normal(len(y))
    record = replace(plan, y=example.spoil(y, np.random.default_rng(seed + 3)) if hidden else y)
    start = believed(example.declared, seed, 0.05)
    seen = Look(start, (record,), (Noise(STD),), (0, len(start.series)))
    return fitted(seen)[0]


def test_every_effect_has_an_example():
    assert {name.partition("/")[0] for name in EXAMPLES} == set(ALL)


@pytest.mark.parametrize("kind", Effect.kinds())
def test_every_effect_says_what_it_is(kind):
    doc = Effect.named(kind).__doc__ or ""
    assert "signature" in doc
    assert "=" in doc or "≤" in doc or "~" in doc or kind in ("soft_knee", "intersample")
    assert Effect.named(kind).places


@pytest.mark.parametrize("example", CASES)
def test_it_finds_its_own_mechanism_and_knows_its_number(example):
    before = look(example, 21)
    effect = example.effect
    starts = effect.screen(before)
    assert starts, "nothing was tried"
    found = refit(before, starts[:2])
    assert found is not None
    assert found.gain > 10
    for name, truth in example.numbers.items():
        if found.told is not None:
            value, std = found.told.numbers[name], found.told.std[name]
        else:
            path = next(n for n in found.candidate.new if n.endswith(name))
            values = dict(
                zip(found.estimate.names, zip(found.estimate.values, found.estimate.std, strict=True), strict=True)
            )
            value, std = values[path]
        assert abs(value - truth) < 4 * std + example.bias * abs(truth), (name, value, truth, std)


@pytest.mark.parametrize("name", ALL)
def test_it_is_silent_on_clean_noise(name, clean):
    kind, _, place = name.partition("@")
    effect = Effect.named(kind)(place=place)
    gains = [starts[0].gain for seen in clean if (starts := effect.screen(seen))]
    assert max(gains, default=0.0) < 10  # nats beyond the penalty: e^-10 a look


@pytest.fixture(scope="module")
def clean():
    example = next(iter(EXAMPLES.values()))
    return [look(example, seed, hidden=False) for seed in (31, 32, 33)]


assert DT > 0
