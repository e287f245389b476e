"""What Wiener-Hammerstein asks for, and whether the answers are worth what was predicted of them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.design_p import PLAN, PLANT, STD, back, front
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.disturbances.white import White
from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.methods._borders import unit_gain
from whid.methods._method import Answered, Wanted
from whid.methods._statistics import OfRecords
from whid.methods.wiener_hammerstein import WienerHammerstein
from whid.refine import bound
from whid.simulate import simulate
from whid.stages.segmentation import segment
from whid.system import System

LAG = Linear(num=(1.0,), den=(0.5, 1.0))
QUICK = Experiment(dt=0.5, parts=(Staircase(from_=-2.0, to=2.0, step=0.5, hold_s=40.0),))
SEED = 61000  # set before the first run of these tests
PIECES = "Segmentation"
STAGED = WienerHammerstein(whole_record=False)


def served(method, plant, plan, seed, most=100, until=""):
    """Run the method, `until` a stage, on a plant that answers up to `most` requests.

    Returns (stages by name, requests, answers in words).
    """
    rng = np.random.default_rng(seed)
    stages, asked, told, answer = {}, [], [], None
    running = method([simulate(plant, plan, rng)])
    try:
        while True:
            found, answer = running.send(answer), None
            if isinstance(found, Wanted):
                asked.append(found)
                if len(asked) <= most:
                    answer = simulate(plant, replace(plan, parts=found.plan), rng)
            elif isinstance(found, Answered):
                told.append(found.text)
            else:
                stages.setdefault(type(found).__name__, []).append(found)
                if type(found).__name__ == until:
                    return stages, asked, told
    except StopIteration:
        return stages, asked, told


def jumping(at, std=0.05):
    """0 below, 2 + u above a jump at `at`, between two lags."""
    f = Piecewise(breaks=(at,), pieces=((0.0,), (2.0, 1.0)))
    return System(chain=(LAG, f, LAG), noise=(White(std=std),))


def test_bisected_borders_are_ten_times_tighter_and_their_error_is_the_predicted_one():
    """The jump lies anywhere in its gap: the error is that of a uniform law, 24 draws of which scatter by 9 %."""
    errors, tighter = [], []
    for k in range(24):
        at = 0.5 + 0.5 * np.random.default_rng(SEED + k).random()
        before, _, _ = served(STAGED, jumping(at), QUICK, SEED + k, most=0, until=PIECES)
        after, asked, told = served(STAGED, jumping(at), QUICK, SEED + k, until=PIECES)
        halving = [w for w in asked if "border" in w.reason]
        assert len(halving) == 7  # 0.5 of 4 down to 1e-3 of 4
        assert len(told) == len(asked)
        (coarse,), (fine,) = before["Segmentation"][0].breaks, after["Segmentation"][0].breaks
        assert abs(coarse - at) < 0.5
        tighter.append(before["Segmentation"][0].break_std[0] / after["Segmentation"][0].break_std[0])
        errors.append((fine - at) / halving[-1].predicted_se)
    assert min(tighter) >= 10
    assert 1 / 1.5 < np.sqrt(np.mean(np.square(errors))) < 1.5


def test_levels_where_f_has_too_few_have_the_predicted_error():
    """f at the new levels, fitted to old and new ones, less true; its errors on one piece go together: about 12 are free."""
    ratios = []
    for k in range(12):
        plant = jumping(1.0 + 0.5 * np.random.default_rng(SEED + 100 + k).random())
        stages, asked, told = served(STAGED, plant, QUICK, SEED + 100 + k, until=PIECES)
        (fill,) = (w for w in asked if "too few levels" in w.reason)
        assert told[-1] == "degrees 0, 1"
        u = np.array([part.level for part in fill.plan])
        pieces = stages["Segmentation"][0]
        f = Piecewise(breaks=tuple(pieces.breaks), pieces=tuple(tuple(c[np.isfinite(c)]) for c in pieces.coefficients))
        ratios += list((f(u, 0.5) - plant.chain[1](u, 0.5)) / fill.predicted_se)
    assert 1 / 1.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_a_kink_is_told_from_a_jump_that_hides_in_its_gap():
    """Design P's jump of −5 at 0.8 reads as a kink at 0.89 until there are levels in between."""
    plant = replace(PLANT, noise=(White(std=STD),))
    plan = replace(PLAN, parts=PLAN.parts[:1])
    before, _, _ = served(STAGED, plant, plan, SEED, most=0, until=PIECES)
    after, _, _ = served(STAGED, plant, plan, SEED, until=PIECES)
    assert before["Segmentation"][0].jump.tolist() == [False, True, False, True]
    found = after["Segmentation"][0]
    assert found.jump.tolist() == [False, True, True, True]
    np.testing.assert_allclose(found.breaks, [-2.4, -0.8, 0.8, 3.2], atol=0.004)  # half a gap of 1e-3 of the range


def test_frequencies_that_connect_the_phases_with_the_predicted_error():
    """Octaves complete the chain of 0.02; their second harmonics' phases, measured less true, over what was predicted."""
    method = replace(STAGED, orders=(2, 2), degree=2)
    errors = []
    for k in range(4):
        plant = replace(PLANT, noise=(White(std=STD),))
        stages, asked, told = served(method, plant, replace(PLAN, initial="steady"), SEED + 200 + k, until="Identifiability")
        (wanted,) = (w for w in asked if "phases fall apart" in w.reason)
        assert [part.period for part in wanted.plan] == [150.0, 75.0]
        kept = 200 * stages["Harmonics"][2].periods  # as many samples as of the sine of 200 samples a period
        assert [part.periods for part in wanted.plan] == [np.ceil(kept / 150), np.ceil(kept / 75)]
        assert told[-1].startswith("2 sines")
        report = stages["Identifiability"][0]
        assert (0.02, 0.04, 0.08, 0.16, 0.32) in [tuple(round(w, 9) for w in group) for group in report.groups]
        for harmonics, part in zip(stages["Harmonics"][-2:], wanted.plan, strict=True):
            w = part.radians(PLAN.dt)
            held = np.exp(-1j * w * PLAN.dt / 2)  # a held cosine is late by half a sample
            true = (held * front(w)) ** 2 * back(2 * w)  # times a positive number: f is quadratic there
            errors.append(np.angle(harmonics.value[2] / true) / wanted.predicted_se)
    assert 1 / 1.5 < np.sqrt(np.mean(np.square(errors))) < 1.5


AFFINE = System(
    chain=(
        Linear(num=(1.0,), den=(0.5, 1.0)),
        Piecewise(breaks=(0.6,), pieces=((0.0,), (-0.6, 1.0))),
        Linear(num=(1.0,), den=(0.1, 0.7, 1.0)),
    ),
    noise=(White(std=0.01),),
)
INSIDE = Experiment(
    dt=0.05,
    parts=(
        Staircase(from_=-2.0, to=4.0, step=0.5, hold_s=15.0),
        Sine(offset=2.5, amplitude=1.0, samples_per_period=(200.0, 100.0, 50.0), periods=10),
    ),
)


def test_sines_across_a_break_tell_front_from_back():
    """Without them only the product is known; with them every number, as well as any unbiased estimate could."""
    before, _, _ = served(STAGED, AFFINE, INSIDE, SEED, most=0)
    assert any("only the product front·back" in said for said in before["Model"][0].missing)
    z, claimed, asked = crossed([SEED])
    (wanted,) = (w for w in asked if "the break at" in w.reason)
    assert [part.period for part in wanted.plan] == [200.0, 100.0, 50.0]
    assert all(abs(part.offset - 0.6) < 0.05 and part.amplitude <= 1 for part in wanted.plan)
    assert np.abs(z).max() < 4.5
    assert 0.9 < claimed.min() <= claimed.max() < 1.2


@pytest.mark.slow
def test_sines_across_a_break_reach_the_bound():
    z, claimed, _ = crossed(range(62_000, 62_040))
    ratio, slack = np.sqrt(np.mean(np.square(z), axis=0)), np.sqrt(chi2.ppf([0.0005, 0.9995], len(z)) / len(z))
    print(f"A6 build, affine pieces crossed: RMSE/CRB {ratio.round(3)} over {len(z)} runs, claimed/CRB {claimed.round(3)}")
    assert np.all(ratio > 0.85 * slack[0])
    assert np.all(ratio < 1.15 * slack[1])


def crossed(seeds):
    """(estimate − truth)/bound of the numbers of both blocks, (runs, numbers); the claimed errors over the bound; requests.

    The bound is that of all samples, those that were asked for among them.
    """
    z, claimed = [], []
    for seed in seeds:
        stages, asked, _ = served(WienerHammerstein(), AFFINE, INSIDE, seed)
        plans = [INSIDE, *(replace(INSIDE, parts=w.plan) for w in asked)]
        records = [simulate(AFFINE, plan, np.random.default_rng(0)) for plan in plans]
        held = (*unit_gain(AFFINE), "chain.1.breaks.0")  # to first order a kink moves as the constant beside it does
        least = bound(replace(AFFINE, noise=()), records, [0.01] * len(records), fixed=held)
        model = stages["Model"][0].estimate
        names = [n for n in least.names if n.startswith(("chain.0", "chain.2"))]
        true = {p.name: p.value for p in AFFINE.tree.parameters(held=True)}
        error = np.array([model.value(n) - true[n] for n in names])
        size = np.array([least.std[least.names.index(n)] for n in names])
        z.append(error / size)
        claimed.append(np.array([model.std[model.names.index(n)] for n in names]) / size)
    return np.array(z), np.mean(claimed, axis=0), asked


def test_beyond_the_budget_the_method_finishes_and_says_what_is_missing():
    stages, asked, told = served(STAGED, jumping(0.8), QUICK, SEED, most=3)
    assert len(told) == 3
    assert len(asked) > 3
    missing = stages["Model"][0].missing
    assert any("where f has its border within" in text for text in missing)
    gap = stages["Segmentation"][0].borders[0]
    assert np.diff(gap) == pytest.approx(0.5 / 8)


def test_without_answers_nothing_but_what_is_missing_changes():
    """Asking in vain leaves every number as a method that does not ask would give it."""
    record = simulate(jumping(0.8), QUICK, np.random.default_rng(SEED))
    curve = OfRecords([record]).curves(10.0)[QUICK.dt]
    vain, asked, _ = served(replace(STAGED, settle_s=10.0), jumping(0.8), QUICK, SEED, most=0, until=PIECES)
    assert asked
    np.testing.assert_array_equal(segment(curve).estimate.values, vain[PIECES][0].estimate.values)
    assert "Bisection" not in vain
