"""Metrics against hand calculations."""

from dataclasses import replace

import numpy as np
import pytest

from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.experiments.hold import Hold
from whid.experiments.sine import Sine
from whid.fit import linear_least_squares
from whid.methods._method import Model
from whid.record import Record
from whid.residual import misfit_of, residual
from whid.score import doubts, linear_gain, score
from whid.system import System

ESTIMATE = linear_least_squares(np.ones((2, 1)), np.ones(2), np.ones(2), ["chain.0.num.0"])


def test_errors_of_each_use_are_apart():
    parts = (Hold(level=0.0, start=0, stop=4), Hold(level=1.0, start=4, stop=8, use="report"))
    record = Record(u=np.ones(8), y=np.array([1.0, -1, 1, -1, 5, 7, 5, 7]), dt=1.0, parts=parts)
    left = np.array([0.3, 0.4, 0.3, 0.4, 2.0, 2.0, 2.0, np.nan])
    record = replace(record, valid=np.isfinite(left))
    found = score(Model(System(chain=(Linear(num=(1.0,), den=(1.0,)),)), ESTIMATE), [record], [misfit_of(record, left)])
    assert found["estimation.rms"] == pytest.approx(np.sqrt(0.125))
    assert found["estimation.nrmse"] == pytest.approx(np.sqrt(0.125))
    assert found["report.rms"] == pytest.approx(2.0)
    assert found["report.fit"] == pytest.approx(100 * (1 - 2.0 / np.std([5.0, 7, 5])))
    assert "selection.rms" not in found


def test_gains_are_compared_after_the_static_gains_are_taken_out():
    truth = System(
        chain=(
            Linear(num=(5.0,), den=(1.0, 1.0)),
            Polynomial(coefficients=(0.0, 0.0, 1.0)),
            Linear(num=(2.0,), den=(0.5, 1.0)),
        )
    )
    same = System(
        chain=(
            Linear(num=(1.0,), den=(1.0, 1.0)),
            Polynomial(coefficients=(0.0, 0.0, 50.0)),
            Linear(num=(1.0,), den=(0.5, 1.0)),
        )
    )
    off = replace(same, chain=(Linear(num=(1.0,), den=(1.1, 1.0)), *same.chain[1:]))
    parts = (
        Hold(level=1.0, start=0, stop=5),
        Hold(level=3.0, start=5, stop=10),
        Sine(offset=1.0, amplitude=1.0, period=10.0, start=10, stop=50),
    )
    record = Record(u=np.ones(50), y=np.zeros(50), dt=0.2, parts=parts)
    found = score(Model(same, ESTIMATE), [record], [misfit_of(record, np.zeros(50))], truth)
    assert all(found[name] < 1e-12 for name in found if ".error." in name)
    found = score(Model(off, ESTIMATE), [record], [misfit_of(record, np.zeros(50))], truth)
    s = 1j * np.pi
    ratio = (s + 1) / (1.1 * s + 1)
    assert found["front.gain.error.max"] == pytest.approx(abs(abs(ratio) - 1) / abs(s + 1))
    assert found["front.phase.error.max"] == pytest.approx(abs(np.angle(ratio)))
    assert found["back.gain.error.max"] < 1e-12
    assert abs(linear_gain(truth, "back", np.array([2.0]))[0] - 1 / (1 + 1j)) < 1e-12


def test_residual_is_missing_where_the_output_is():
    record = Record(u=np.ones(3), y=np.array([1.0, np.nan, 3.0]), dt=1.0, valid=np.array([True, False, True]))
    left = residual(Linear(num=(2.0,), den=(1.0,)), record)
    assert np.array_equal(left, [-1.0, np.nan, 1.0], equal_nan=True)


def test_what_speaks_against_a_model_is_said():
    model = Model(System(chain=(Linear(num=(1.0,), den=(1.0,)),)), ESTIMATE._replace(chi2=4.0, dof=2))
    assert list(doubts(model, {"estimation.nrmse": 0.1})) == []
    poor = model._replace(estimate=ESTIMATE._replace(chi2=80.0, dof=2, why_stop="iteration limit"))
    misfit, useless, unfinished = doubts(poor, {"estimation.nrmse": 1.2})
    assert "χ²/dof 40" in misfit
    assert "constant" in useless
    assert "limit" in unfinished


def test_where_only_the_product_is_claimed_the_product_is_judged():
    truth = System(
        chain=(Linear(num=(5.0,), den=(1.0, 1.0)), Polynomial(coefficients=(0.0, 1.0)), Linear(num=(2.0,), den=(0.5, 1.0)))
    )
    ours = System(
        chain=(Linear(num=(1.0,), den=(0.5, 1.5, 1.0)), Polynomial(coefficients=(0.0, 10.0)), Linear(num=(1.0,), den=(1.0,)))
    )
    record = Record(
        u=np.ones(50), y=np.zeros(50), dt=0.2, parts=(Sine(offset=1.0, amplitude=1.0, period=10.0, start=10, stop=50),)
    )
    found = score(Model(ours, ESTIMATE), [record], [misfit_of(record, np.zeros(50))], truth)
    assert found["linear.gain.error.max"] < 1e-12
    assert found["linear.phase.error.max"] < 1e-12
    assert not any(name.startswith(("front", "back")) for name in found)
