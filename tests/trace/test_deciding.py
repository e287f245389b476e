"""The experiment that would decide: what it predicts is what the true plant then shows (seeds below 20000)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from whid.blocks.backlash import Backlash
from whid.blocks.dead_zone import DeadZone
from whid.blocks.linear import Linear
from whid.effects._effect import Effect
from whid.effects._look import Look, Noise
from whid.experiments._experiment import Experiment
from whid.predict import predict
from whid.record import Record
from whid.refine import refine
from whid.system import System
from whid.trace._deciding import deciding
from whid.trace._gate import Gate
from whid.trace._refit import fitted, refit
from whid.trace._round import CLASS
from whid.trace._state import State

LAG, DT, STD = Linear(num=(2.0,), den=(0.5, 1.0), fix=("den.1",)), 0.1, 0.05
RISING = np.repeat(np.linspace(0.5, 3.0, 11), 40)
TRUTHS = {"backlash": Backlash(gap=0.4), "dead_zone": DeadZone(low=-0.2, high=0.2, fix=("slope",))}


def measured(block, u, seed, name):
    blank = Record(u=u, y=np.zeros(len(u)), dt=DT, initial="steady", name=name)
    return replace(
        blank, y=predict(System(chain=(block, LAG)).tree, blank) + STD * np.random.default_rng(seed).standard_normal(len(u))
    )


def ambiguous(truth, seed):
    """Return what a staircase that only rises leaves open: a play or a dead zone of the actuator."""
    record = measured(TRUTHS[truth], RISING, seed, "rising")
    look, estimate = fitted(Look(System(chain=(LAG,)), (record,), (Noise(STD),), (0, 1)))
    fits = []
    for kind in ("backlash", "dead_zone"):
        effect = Effect.named(kind)(place="input")
        fits.append(refit(look, effect.screen(look)[:2]))
    right, wrong = fits if truth == "backlash" else fits[::-1]
    return record, State(right.look, estimate, Gate((), 1.0), right, (wrong,))


def best(found, records):
    """Return the least χ² that a model reaches on records, its effect started at several sizes."""
    reached = []
    for size in (0.02, 0.3, 1.0):
        start = found.candidate.at({name: size * value for name, value in found.candidate.values.items()}).system
        fit = refine(start, records, std=[STD] * len(records))
        reached.append(sum(float(n * (r / STD) ** 2) for n, r in zip(fit.samples, fit.rms, strict=True)))
    return min(reached)


@pytest.mark.parametrize("truth", TRUTHS)
def test_what_decides_is_named_and_the_true_plant_then_decides(truth):
    record, state = ambiguous(truth, 41)
    right, (wrong,) = state.added, state.rivals
    assert abs(right.chi2 - wrong.chi2) < 2 * CLASS  # the record itself does not tell
    wanted = deciding(state, STD)
    assert wanted is not None
    assert "differ there by" in wanted.reason
    separation = float(wanted.reason.split(" standard errors")[0].split()[-1])
    assert separation > 10
    plan = Experiment(dt=DT, parts=wanted.plan, initial="steady")
    u = plan.input(plan.plan(), np.random.default_rng(0))
    assert record.u.min() - 1e-9 <= u.min() < u.max() <= record.u.max() + 1e-9
    told = measured(TRUTHS[truth], u, 42, "deciding")
    gained = best(wrong, [record, told]) - best(right, [record, told])  # χ², both having absorbed what they can
    assert gained > 2 * CLASS
    assert separation**2 / 2 < gained < 2 * separation**2


def test_nothing_decides_between_the_same_model_twice():
    _, state = ambiguous("backlash", 43)
    assert deciding(state._replace(rivals=(state.added,)), STD) is None
