"""Bars A7 and A9 on design P: the whole-record fit against the Cramér-Rao bound, and the method end to end."""

import time
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval
from scipy.stats import binom, chi2

from tests.design_p import PLAN, PLANT, STD, clean, record
from whid.blocks.chain import Chain
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.methods._assemble import rivals_of
from whid.methods._borders import located, unit_gain
from whid.methods._search import Search
from whid.methods._whole import whole_record
from whid.methods.wiener_hammerstein import WienerHammerstein
from whid.predict import predict
from whid.refine import refine
from whid.simulate import simulate
from whid.system import System

FIRST_SEED = 9000  # set before the first run of these tests; they served development
REPORTED = 95_000  # the bars' own counts are on these, which nothing was looked at on; 12 000 and 90 000 on were
TRUE = replace(
    PLANT, chain=(Linear(num=(1.0,), den=(25.0, 12.5, 1.0)), PLANT.chain[1], Linear(num=(1.0,), den=(10.0, 7.0, 1.0)))
)
NAMES = (
    "chain.0.den.0", "chain.0.den.1", "chain.1.breaks.0", "chain.1.breaks.1", "chain.1.breaks.2", "chain.1.breaks.3",
    "chain.1.pieces.0.0", "chain.1.pieces.1.1", "chain.1.pieces.2.0", "chain.1.pieces.3.0", "chain.1.pieces.3.1",
    "chain.1.pieces.3.2", "chain.1.pieces.4.0", "chain.1.pieces.4.1", "chain.2.den.0", "chain.2.den.1",
)  # fmt: skip
TRUTH = {p.name: p.value for p in TRUE.tree.parameters()}


@lru_cache
def stages(seed):
    return {type(s).__name__: s for s in WienerHammerstein(whole_record=False)([record(seed)])}


def staged(seed):
    """The staged model, as the method hands it to its last stage."""
    return stages(seed)["Model"]


@lru_cache
def crb():
    """Cramér-Rao bound of the 16 numbers, from finite differences of simulations; the kink's constant follows."""

    def response(name, x):
        values = TRUTH | {name: TRUTH[name] + x}
        b, c = values["chain.1.breaks.0"], values["chain.1.pieces.0.0"]
        values["chain.1.pieces.1.0"] = c - values["chain.1.pieces.1.1"] * b
        return predict(TRUE.tree.with_parameters(values), clean())

    columns = []
    for name in NAMES:
        step = 1e-5 * max(abs(TRUTH[name]), 0.1)
        columns.append((response(name, step) - response(name, -step)) / (2 * step))
    jacobian = np.array(columns).T / STD
    return np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))


def meeting(f, k):
    """f with a kink at break k: there the levels' own degrees are cut off, so that its pieces no longer meet."""
    left, right = (polyval(f.breaks[k], piece) for piece in f.pieces[k : k + 2])
    piece = (f.pieces[k + 1][0] + left - right, *f.pieces[k + 1][1:])
    return replace(f, pieces=(*f.pieces[: k + 1], piece, *f.pieces[k + 2 :]))


def check_a7(count, first=FIRST_SEED):
    errors, seconds, failed = [], [], []
    for seed in range(first, first + count):
        model, data = staged(seed), record(seed)
        f = model.system.chain[1]
        if [len(p) for p in f.pieces] != [1, 2, 1, 3, 2]:  # A3's business: start from the right structure
            f = replace(f, pieces=tuple((*p, *[0.0] * 3)[:n] for p, n in zip(f.pieces, [1, 2, 1, 3, 2], strict=True)))
        started = replace(model.system, chain=(model.system.chain[0], meeting(f, 0), model.system.chain[2]))
        system = located(started, [data], 1, (1, 2, 3))  # three jumps, whatever the levels read
        began = time.process_time()
        search = Search([data], 1, 3, refine(system, [data], fixed=unit_gain(system)))
        search.orders(
            rivals_of(stages(seed)["Rational"], system)
        )  # as the method does: orders the stages could not tell apart
        search.roots()  # and a pole that they found in noise
        found = search.best
        seconds.append(time.process_time() - began)
        if not set(NAMES) <= set(found.estimate.names) or len(found.estimate.names) != len(NAMES) + 1:
            failed.append((seed, [name for name in found.estimate.names if "chain.1" not in name]))
            continue
        error = np.array([found.estimate.value(name) - TRUTH[name] for name in NAMES])
        good = found.estimate.why_stop == "converged" and np.all(np.abs(error) < 10 * crb())
        failed += [] if good else [(seed, found.estimate.why_stop, (error / crb()).round(1))]
        errors.append(error)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / crb()
    print(f"\nA7 RMSE/CRB of {len(NAMES)} numbers over {count} seeds: {ratio.round(3)} (bar .85 … 1.15)")
    print(f"A7 failures {failed} of {count}; a fit: median {np.median(seconds):.2f} s, most {max(seconds):.2f} (bar 3)")
    spread = np.sqrt(chi2.ppf([0.0005, 0.9995], count) / count)
    assert not failed
    assert np.all(ratio <= 1.15 * spread[1])
    assert np.all(ratio >= 0.85 * spread[0])
    assert np.median(seconds) <= 3.0


def check_a9(count, first=FIRST_SEED):
    wrong = []
    for seed in range(first, first + count):
        *_, stage, model = WienerHammerstein()([record(seed)])
        e = model.estimate
        z = np.array([(e.value(name) - TRUTH[name]) / e.std[e.names.index(name)] for name in NAMES])
        degrees = [len(p) - 1 for p in model.system.chain[1].pieces]
        orders = [len(model.system.chain[k].den) - 1 for k in (0, 2)]
        right = stage.borders == ("kink", "jump", "jump", "jump") and degrees == [0, 1, 0, 2, 1] and orders == [2, 2]
        if not right or np.abs(z).max() >= 5:
            wrong.append((seed, stage.borders, degrees, orders, float(np.abs(z).max())))
    print(f"\nA9 right, and every |z| < 5, in {count - len(wrong)} of {count} seeds (bar 98 %); wrong: {wrong}")
    assert binom.sf(len(wrong) - 1, count, 0.02) > 0.001


def test_a7_reduced():
    check_a7(4)


def test_a9_reduced():
    check_a9(2)


@pytest.mark.slow
def test_a7():
    check_a7(300, REPORTED)


@pytest.mark.slow
def test_a9():
    check_a9(120, REPORTED)


def test_levels_read_a_small_jump_as_a_kink_and_the_record_knows_better():
    model = staged(FIRST_SEED)
    assert abs(model.system.chain[1].breaks[2] - 0.895) < 0.01  # where the quadratic crosses 0
    stage, found = whole_record([record(FIRST_SEED)], model, 3)
    f = found.system.chain[1]
    assert f.breaks[2] == pytest.approx(0.8, abs=0.03)
    assert f.jumps()[2] == pytest.approx(-5.0, abs=1.5)
    assert stage.rms < stage.before
    assert stage.rms == pytest.approx(STD, rel=4 / np.sqrt(2 * stage.samples))


def lagged(f, parts, seed, noise=0.02):
    plant = System(chain=(Linear(num=(1.0,), den=(1.0, 1.0)), f, Linear(num=(1.0,), den=(0.4, 1.0))))
    quiet = simulate(plant, Experiment(dt=0.05, parts=parts), np.random.default_rng(seed))
    return replace(quiet, y=quiet.y + noise * np.random.default_rng(seed).standard_normal(len(quiet)))


STAIRS = Staircase(from_=-4.0, to=4.0, step=0.5, hold_s=20.0, return_=True)
WAVES = Sine(offset=1.6, amplitude=1.2, samples_per_period=(400.0, 200.0, 100.0), periods=10)


def test_a_true_kink_stays_one():
    f = Piecewise(breaks=(0.75,), pieces=((-0.75,), (-2.25, 2.0)))
    *_, stage, model = WienerHammerstein()([lagged(f, (STAIRS, WAVES), 31)])
    assert stage.borders == ("kink",)
    e = model.estimate
    assert abs(e.value("chain.1.breaks.0") - 0.75) < 5 * e.std[e.names.index("chain.1.breaks.0")]


def test_a_degree_that_the_levels_overstate_is_taken_back():
    model = staged(FIRST_SEED)
    f = model.system.chain[1]
    grown = replace(f, pieces=(f.pieces[0], f.pieces[1], (*f.pieces[2], 0.01), *f.pieces[3:]))
    names = (*model.estimate.names, "chain.1.pieces.2.1")
    system = replace(model.system, chain=(model.system.chain[0], grown, model.system.chain[2]))
    stage, found = whole_record([record(FIRST_SEED)], model._replace(system=system), 3)
    assert [len(p) - 1 for p in found.system.chain[1].pieces] == [0, 1, 0, 2, 1]
    assert any("piece 3 has degree 0" in text for text in stage.decided)
    assert names[-1] not in stage.estimate.names


def test_a_pole_that_the_stages_found_in_noise_is_taken_back():
    """Front with a third pole at 2.8 rad/s, and a back with a pole and a zero that cancel: neither is in the plant."""
    model = staged(FIRST_SEED)
    front, f, back = model.system.chain
    front = replace(front, den=tuple(np.convolve(front.den, [1 / 2.8, 1.0])))
    back = replace(back, num=(1 / 0.31, 1.0), den=tuple(np.convolve(back.den, [1 / 0.3, 1.0])))
    grown = replace(model.system, chain=(front, f, back))
    stage, found = whole_record([record(FIRST_SEED)], model._replace(system=grown), 3)
    assert [len(found.system.chain[k].den) - 1 for k in (0, 2)] == [2, 2]
    assert found.system.chain[2].num == (1.0,)
    assert "chain.0 has one pole less than the stages before found" in stage.decided
    error = np.array([stage.estimate.value(name) - TRUTH[name] for name in NAMES])
    assert np.abs(error / crb()).max() < 5


def test_it_can_be_left_out_and_is_left_out_of_what_it_cannot_split():
    data = record(FIRST_SEED)
    kinds = [type(stage).__name__ for stage in WienerHammerstein(whole_record=False)([data])]
    assert "WholeRecord" not in kinds
    assert kinds[-1] == "Model"


def test_report_samples_stay_closed():
    data = record(FIRST_SEED)
    last = data.parts[-1]
    parts = (*data.parts[:-1], replace(last, use="report"))
    a = replace(data, parts=parts)
    b = replace(a, y=np.where(a.using("report"), np.nan, a.y))
    results = [whole_record([r], staged(FIRST_SEED), 3)[0].estimate.values for r in (a, b)]
    assert results[0].tolist() == results[1].tolist()
    assert isinstance(TRUE.tree, Chain)
    assert len(PLAN.plan()) == len(data.parts)


def test_a_fit_that_fails_leaves_the_staged_model(monkeypatch):
    orders_told = []

    def failing(*_, told, **options):
        orders_told.append(told)
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr("whid.methods.wiener_hammerstein.whole_record", failing)
    list(WienerHammerstein(orders=(2, 2))([record(FIRST_SEED)]))
    *_, model = WienerHammerstein()([record(FIRST_SEED)])
    assert orders_told == [True, False]  # orders that were given stay
    assert model.system == staged(FIRST_SEED).system
    assert any("whole-record fit failed: singular" in text for text in model.missing)
