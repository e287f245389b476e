"""The interface of an effect, shown by a small one: an offset at the output."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.stats import chi2

from whid.blocks.chain import Chain
from whid.blocks.constant import Constant
from whid.blocks.linear import Linear
from whid.effects._effect import Effect, Evidence, Place
from whid.fit import linear_least_squares
from whid.methods._method import Model
from whid.predict import predict
from whid.record import Record
from whid.residual import explain
from whid.system import System


@dataclass(frozen=True, kw_only=True)
class Offset(Effect):
    """y = x + offset: a branch beside the chain."""

    places: ClassVar[tuple[Place, ...]] = ("output",)
    place: Place = "output"

    def evidence(self, residuals):
        error = np.concatenate([r.error[np.isfinite(r.error)] for r in residuals])
        statistic = len(error) * error.mean() ** 2 / error.var()
        return Evidence(statistic / 2 - 0.5 * np.log(len(error)), float(chi2.sf(statistic, 1)), "everywhere")

    def extend(self, model, records):
        left = np.concatenate([explain(model.system.tree, r).error for r in records])
        fit = linear_least_squares(np.ones((len(left), 1)), left, names=["chain.0.parallel.1.level"])
        return model._replace(system=model.system.beside(Constant(level=float(fit.values[0]))), estimate=fit)


def records(offset, seed):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(400)
    blank = Record(u=u, y=u, dt=0.1)
    y = predict(PLANT.tree, blank) + offset + 0.1 * rng.standard_normal(400)
    return [replace(blank, y=y)]


PLANT = System(chain=(Linear(num=(1.0,), den=(0.5, 1.0)),))
MODEL = Model(PLANT, linear_least_squares(np.ones((2, 1)), np.ones(2)))


def test_evidence_then_edit_then_nothing_left():
    data = records(0.3, 1)
    before = Offset().evidence([explain(PLANT.tree, r) for r in data])
    extended = Offset().extend(MODEL, data)
    after = Offset().evidence([explain(extended.system.tree, r) for r in data])
    assert before.statistic > 10 > 0 > after.statistic
    found = extended.estimate
    assert abs(found.values[0] - 0.3) < 4 * found.std[0]
    path = found.names[0]
    assert {p.name: p.value for p in extended.system.tree.parameters()}[path] == found.values[0]


def test_silent_on_clean_noise():
    p = [Offset().evidence([explain(PLANT.tree, r) for r in records(0.0, seed)]).p for seed in range(100, 200)]
    assert sum(x < 0.01 for x in p) <= 5  # binomial(100, .01): more has a chance of 5e-4


def test_edits_of_a_system():
    lag, gain = Linear(num=(1.0,), den=(1.0, 1.0)), Linear(num=(3.0,), den=(1.0,))
    assert PLANT.inserted(0, gain).chain == (gain, *PLANT.chain)
    assert PLANT.inserted(1, gain).chain == (*PLANT.chain, gain)
    assert PLANT.replaced(0, Chain(chain=(lag, gain))).chain == (Chain(chain=(lag, gain)),)
    u = np.random.default_rng(0).standard_normal(50)
    assert np.allclose(PLANT.beside(gain).tree(u, 0.1), PLANT.tree(u, 0.1) + 3 * u)
