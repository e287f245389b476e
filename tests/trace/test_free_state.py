"""A record that begins in a state nobody knows: the loop looks at it as the fit does, and report data stay closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whid.blocks.linear import Linear
from whid.effects._look import Look, Noise
from whid.experiments.steps import Steps
from whid.predict import predict
from whid.record import Record
from whid.system import System
from whid.trace._refit import fitted

LAG, DT, STD = Linear(num=(2.0,), den=(12.0, 8.0, 1.0), fix=("den.2",)), 0.5, 0.01


def late(seed):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, 30), 20)
    whole = Record(u=u, y=np.zeros(600), dt=DT)
    y = predict(System(chain=(LAG,)).tree, whole) + STD * rng.standard_normal(600)
    parts = (Steps(start=0, stop=300), Steps(start=300, stop=500, use="report"))
    return Record(u=u[100:], y=y[100:], dt=DT, initial="free", parts=parts)


def test_the_residual_is_that_of_the_fit():
    record = late(61).without("report")
    look, estimate = fitted(Look(System(chain=(replace(LAG, num=(1.8,)),)), (record,), (Noise(STD),), (0, 1)))
    left = look.errors[0][look.use[0]]
    assert look.past[0].lead > 0
    assert 0.85 < np.sqrt(np.mean(left**2)) / STD < 1.15  # 300 samples: a standard error of .04
    assert np.abs(left[:10]).max() < 5 * STD  # from the first sample on
    assert abs(estimate.values[0] - 2.0) < 4 * estimate.std[0]
    assert look.basis.shape[1] == len(estimate.names) + len(look.past[0].levels)


def test_report_samples_have_no_part_in_the_state():
    record = late(62)
    tree = System(chain=(LAG,)).tree
    spoilt = replace(record, y=np.where(record.using("report"), 100.0, record.y))
    assert (predict(tree, record) == predict(tree, spoilt)).all()
