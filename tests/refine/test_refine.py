"""The whole-record fit against finite differences, closed forms, scipy, and Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from scipy.signal import lfilter

from whid.blocks.chain import Chain
from whid.blocks.dead_zone import DeadZone
from whid.blocks.delay import Delay
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.blocks.polynomial import Polynomial
from whid.errors import WhidError
from whid.experiments.hold import Hold
from whid.experiments.sine import Sine
from whid.fit import Estimate
from whid.predict import predict
from whid.record import Record
from whid.refine import band, bound, gains, multistart, profile, refine
from whid.refine._free import FreeNumbers
from whid.refine._periodic import periodic
from whid.refine._problem import KEPT, Data, Problem, data_of
from whid.system import System

HARD = System(
    chain=(
        Linear(num=(1.0,), den=(0.8, 1.4, 1.0)),
        Piecewise(breaks=(-0.5, 0.6), pieces=((0.3, 0.6), (0.0,), (-0.36, 0.0, 1.0))),  # a jump, then a kink
        Linear(num=(0.3, 1.0), den=(0.5, 1.0)),
    )
)
CURVE = System(chain=(Polynomial(coefficients=(0.5, 1.0, -0.3)),))
CUT = 585  # in the middle of a transition
UNIT = ("chain.0.num.0", "chain.0.den.2", "chain.2.num.1", "chain.2.den.1")


def steps(seed, samples=600, hold=12, size=1.5):
    return np.repeat(np.random.default_rng(seed).normal(size=samples // hold), hold) * size


def recorded(system, u, dt=0.1, noise=0.0, seed=0, **given):
    record = Record(u=u, y=np.zeros(len(u)), dt=dt, **given)
    return replace(record, y=predict(system.tree, record) + noise * np.random.default_rng(seed).normal(size=len(u)))


def moved(system, factor):
    free = system.tree.parameters()
    return replace(system, chain=system.tree.with_parameters({p.name: p.value * factor for p in free}).chain)


@pytest.mark.parametrize("initial", ["rest", "steady", "free"])
@pytest.mark.parametrize("path", ["exact", "sampled"])
def test_tangents_are_those_of_finite_differences(initial, path):
    record = replace(recorded(HARD, steps(1)), initial=initial, y=np.zeros(600))
    problem = Problem(FreeNumbers(HARD.tree, UNIT), data_of([record], HARD.tree), path)
    theta = problem.start
    if initial == "free":
        theta[-3:] = [0.4, -0.8, 0.3]  # the levels of the past
    rows = np.vstack(list(problem._rows(theta, tangents=True)))

    def residual(x):
        return np.vstack(list(problem._rows(x, tangents=False)))[:, 0]

    assert np.array_equal(rows[:, -1], residual(theta))
    smooth = ~np.array(["breaks" in p.name for p in problem.parameters]) if path == "sampled" else np.ones(len(theta), bool)
    for k in np.flatnonzero(smooth):  # on the sampled path a jump does not move continuously
        h = 1e-6 * np.eye(len(theta))[k]
        numeric = (residual(theta + h) - residual(theta - h)) / 2e-6
        if path == "sampled" or initial == "steady":  # a sample may step over the jump
            close = np.abs(rows[:, k] - numeric) < 1e-5 * (1 + np.abs(rows[:, k]).max())
            assert close.mean() > 0.99
        else:
            np.testing.assert_allclose(rows[:, k], numeric, atol=2e-6 * (1 + np.abs(rows[:, k]).max()))


def test_it_finds_a_hard_nonlinearity_between_two_linear_blocks():
    record = recorded(HARD, steps(2, 3000), noise=0.01, seed=3)
    rough = Piecewise(breaks=(-0.47, 0.7), pieces=((0.4, 0.7), (0.05,), (-0.44, 0.0, 1.0)))
    start = System(chain=(replace(HARD.chain[0], den=(0.7, 1.5, 1.0)), rough, replace(HARD.chain[2], den=(0.6, 1.0))))
    found = refine(start, [record], fixed=UNIT)
    assert found.estimate.why_stop in ("converged", "small step")
    assert found.rms[0] == pytest.approx(0.01, rel=4 / np.sqrt(2 * 3000))
    truth = {p.name: p.value for p in HARD.tree.parameters()}
    e = found.estimate
    z = [(v - truth[n]) / s for n, v, s in zip(e.names, e.values, e.std, strict=True)]
    assert np.abs(z).max() < 5, dict(zip(e.names, z, strict=True))
    assert found.estimate.chi2 == pytest.approx(found.estimate.dof)
    curve = found.system.chain[1]
    assert curve.kinks().tolist() == [False, True]  # what met keeps meeting


def test_scipy_finds_the_same_minimum():
    u, dt = steps(4), 0.1
    truth = System(chain=(Linear(num=(0.1,), den=(1.0, -0.9), dt=dt), Polynomial(coefficients=(0.0, 1.0, 0.4))))
    y = predict(truth.tree, Record(u=u, y=u, dt=dt, intersample="discrete")) + 0.05 * np.random.default_rng(5).normal(
        size=600
    )
    record = Record(u=u, y=y, dt=dt, intersample="discrete")
    found = refine(truth, [record], fixed=("chain.0.num", "chain.0.den.0", "chain.1.coefficients.0"))

    def residual(p):
        v = lfilter([0.0, 0.1], [1.0, p[0]], u)  # 0.1/(z + a)
        return p[1] * v + p[2] * v**2 - y

    other = scipy.optimize.least_squares(residual, [-0.8, 1.0, 0.1], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    names = ("chain.0.den.1", "chain.1.coefficients.1", "chain.1.coefficients.2")
    np.testing.assert_allclose([found.estimate.value(n) for n in names], other.x, rtol=1e-5)
    covariance = np.linalg.inv(other.jac.T @ other.jac) * 2 * other.cost / (600 - 3)
    np.testing.assert_allclose(found.estimate.std, np.sqrt(np.diag(covariance)), rtol=1e-4)


def test_selection_report_and_missing_samples_are_never_looked_at():
    parts = (Hold(level=0, start=0, stop=300), Hold(level=0, start=300, stop=400, use="selection"),
             Hold(level=0, start=400, stop=500, use="report"), Hold(level=0, start=500, stop=600))  # fmt: skip
    valid = np.ones(600, bool)
    valid[100:120] = False
    record = recorded(HARD, steps(6), noise=0.02, parts=parts, valid=valid)
    hidden = record.y.copy()
    hidden[300:500] = np.nan
    hidden[100:120] = 1e9
    for noise in ("white", "ar"):
        a, b = (refine(HARD, [replace(record, y=y)], fixed=UNIT, noise=noise) for y in (record.y, hidden))
        assert a.estimate.values.tolist() == b.estimate.values.tolist()
        assert a.samples.tolist() == [380.0]


def test_records_are_weighted_by_their_own_noise():
    u = [np.random.default_rng(k).uniform(-2, 2, n) for k, n in ((7, 400), (8, 3000))]
    records = [recorded(CURVE, x, noise=s, seed=9, name=f"r{s}") for x, s in zip(u, (0.01, 1.0), strict=True)]
    found = refine(CURVE, records)
    assert found.noise_std == pytest.approx([0.01, 1.0], rel=0.15)
    design = np.vander(np.concatenate(u), 3, increasing=True) / np.repeat(found.noise_std, [400, 3000])[:, None]
    y = np.concatenate([r.y for r in records]) / np.repeat(found.noise_std, [400, 3000])
    np.testing.assert_allclose(found.estimate.values, np.linalg.lstsq(design, y, rcond=None)[0], rtol=1e-5)
    np.testing.assert_allclose(found.estimate.std, np.sqrt(np.diag(np.linalg.inv(design.T @ design))), rtol=5e-3)


def test_coloured_noise_is_prewhitened_across_holes():
    """Generalised least squares with the true covariance, holes cut out, is the reference."""
    n, a = 800, 0.85
    rng = np.random.default_rng(10)
    u = np.cumsum(rng.normal(size=n)) / 15
    e = lfilter([1.0], [1.0, -a], rng.normal(size=n + 200))[200:] * 0.1
    valid = np.ones(n, bool)
    valid[[50, 51, 52, 300, 500]] = False
    record = Record(u=u, y=predict(CURVE.tree, Record(u=u, y=u, dt=1.0)) + e, dt=1.0, valid=valid)
    found = refine(CURVE, [record], noise="ar")
    assert np.isfinite(found.ar).sum() == 1
    assert found.ar[0, 0] == pytest.approx(a, abs=0.08)
    ar = found.ar[0, 0]
    covariance = ar ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) / (1 - ar**2)
    stretches = np.cumsum(~valid)
    covariance[stretches[:, None] != stretches] = 0.0  # stretches on their own, as the fit takes them
    inverse = np.linalg.inv(covariance[np.ix_(valid, valid)])
    x = np.vander(u[valid], 3, increasing=True)
    gls = np.linalg.solve(x.T @ inverse @ x, x.T @ inverse @ record.y[valid])
    np.testing.assert_allclose(found.estimate.values, gls, rtol=1e-4, atol=1e-5)
    white = refine(CURVE, [record])
    assert found.estimate.std[0] > 2 * white.estimate.std[0]  # white errors would be far too small


def test_wild_samples_hardly_move_a_robust_fit():
    rng = np.random.default_rng(11)
    record = recorded(CURVE, rng.uniform(-2, 2, 500), noise=0.05, seed=12)
    wild = record.y.copy()
    wild[::25] += 8.0
    plain, robust = (refine(CURVE, [replace(record, y=wild)], robust=r).estimate for r in (False, True))
    truth = np.array([0.5, 1.0, -0.3])
    assert np.abs(robust.values - truth).max() < 0.03 < np.abs(plain.values - truth).max()


def test_tied_and_held_numbers():
    truth = System(
        chain=(Linear(num=(1.0,), den=(0.5, 1.0)), DeadZone(low=-0.4, high=0.4), Linear(num=(1.0,), den=(0.5, 1.0)))
    )
    record = recorded(truth, steps(13, 1200), noise=0.01)
    start = replace(truth, chain=(replace(truth.chain[0], den=(0.7, 1.0), fix=("num",)), *truth.chain[1:]))
    fixed = ("chain.0.den.1", "chain.2.num", "chain.2.den.1", "chain.1.slope")
    found = refine(start, [record], fixed=fixed, tied=[("chain.0.den.0", "chain.2.den.0")])
    assert found.estimate.value("chain.0.den.0") == found.estimate.value("chain.2.den.0") == pytest.approx(0.5, abs=0.01)
    assert not {"chain.0.num.0", "chain.1.slope"} & set(found.estimate.names)
    apart = refine(start, [record], fixed=fixed)
    assert found.estimate.std[0] < apart.estimate.std[0]
    for wrong in ({"fixed": ["chain.7"]}, {"tied": [("chain.0.den.0", "chain.9.x")]}):
        with pytest.raises(WhidError, match="chain"):
            refine(truth, [record], **wrong)


def test_what_the_data_cannot_tell_is_said_in_words():
    system = System(chain=(Delay(seconds=0.25), *HARD.chain, Delay(seconds=0.35)))
    found = refine(system, [recorded(system, steps(14), noise=0.01)], max_iterations=2)
    text = "\n".join(found.gauge)
    assert "delay may sit in either block: chain.0 (delay) or chain.4 (delay)" in text
    assert "gain may move between chain.1 (linear) and chain.2 (piecewise)" in text
    assert "num and den of chain.3 (linear) may be scaled together" in text
    assert np.isfinite(found.estimate.std).all()
    beyond = System(chain=(Piecewise(breaks=(50.0,), pieces=((0.0, 1.0), (7.0, 2.0))),))
    unseen = refine(beyond, [recorded(beyond, steps(14))])
    assert unseen.gauge == ("the data do not determine chain.0.breaks.0, chain.0.pieces.1.0, chain.0.pieces.1.1",)


def test_ctrl_c_keeps_the_best_so_far():
    record = recorded(HARD, steps(15), noise=0.01)

    def stop(iteration, cost):
        if iteration == 2:
            raise KeyboardInterrupt

    start = moved(HARD, 1.02)
    found = refine(start, [record], fixed=UNIT, watch=stop)
    assert found.estimate.why_stop == "interrupted"
    before = np.sqrt(np.mean((predict(start.tree, record) - record.y) ** 2))
    assert found.rms[0] < before


def test_an_unknown_past_is_a_nuisance():
    """The record is cut out of a longer one: whatever was before it must not bias the model."""
    whole = recorded(HARD, steps(16, 1200), noise=0.01)
    piece = Record(u=whole.u[CUT : CUT + 300], y=whole.y[CUT : CUT + 300], dt=0.1, initial="free")
    found = refine(HARD, [piece], fixed=UNIT)
    truth = {p.name: p.value for p in HARD.tree.parameters()}
    e = found.estimate
    z = [(v - truth[n]) / s for n, v, s in zip(e.names, e.values, e.std, strict=True)]
    assert np.abs(z).max() < 5
    assert found.rms[0] == pytest.approx(0.01, rel=0.2)
    assert refine(HARD, [replace(piece, initial="rest")], fixed=UNIT).rms[0] > 0.02
    assert not any("past" in name for name in e.names)


def test_the_bound_is_that_of_the_normal_equations_and_of_monte_carlo():
    u = np.random.default_rng(17).uniform(-2, 2, 200)
    plan = Record(u=u, y=np.full(200, np.nan), dt=1.0)
    x = np.vander(u, 3, increasing=True)
    expected = 0.3 * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
    np.testing.assert_allclose(bound(CURVE, [plan], [0.3]).std, expected, rtol=1e-9)
    runs = [refine(CURVE, [recorded(CURVE, u, 1.0, 0.3, 1000 + k)]).estimate.values for k in range(200)]
    np.testing.assert_allclose(np.std(runs, axis=0) / expected, 1.0, atol=4 / np.sqrt(2 * 200))
    correlated = bound(CURVE, [plan], [0.3], ar=np.array([0.9]))
    assert correlated.std[0] > 3 * expected[0]


def test_the_band_is_the_spread_of_predictions():
    record = recorded(HARD, steps(18), noise=0.02)
    estimate = bound(HARD, [record], [0.02], fixed=UNIT)
    width = band(HARD.tree, record, estimate)
    draws = np.random.default_rng(19).multivariate_normal(estimate.values, estimate.covariance, 200)
    spread = []
    for theta in draws:
        tree = HARD.tree.with_parameters(dict(zip(estimate.names, theta.tolist(), strict=True)))
        spread.append(predict(tree, record))
    ratio = np.std(spread, axis=0)[50:] / width[50:]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
    assert np.quantile(ratio, [0.02, 0.98]) == pytest.approx([1, 1], abs=0.2)


def test_a_score_test_foresees_what_a_number_gains():
    record = recorded(CURVE, np.random.default_rng(20).uniform(-2, 2, 400), noise=0.1)
    short = System(chain=(Polynomial(coefficients=(0.5, 1.0)),))
    fit = refine(short, [record])
    longer = replace(fit.system, chain=(Polynomial(coefficients=(*fit.system.chain[0].coefficients, 0.0)),))
    gain = gains(longer, [record], ["chain.0.coefficients.2"])[0]
    full = refine(CURVE, [record])
    assert gain == pytest.approx(400 * (1 - full.rms[0] ** 2 / fit.rms[0] ** 2), rel=1e-6)
    assert full.bic < fit.bic


def test_profile_and_several_starts():
    truth = System(chain=(Linear(num=(1.0,), den=(0.5, 1.0)), DeadZone(low=-0.4, high=0.7)))
    record = recorded(truth, steps(21), noise=0.01)
    cost = profile(truth, [record], "chain.1.high", np.array([0.5, 0.7, -1.0]))
    assert cost[1] < cost[0]
    assert np.isinf(cost[2])  # high below low is no dead zone
    found = multistart(truth, [record], 4, np.random.default_rng(22), fixed=("chain.0.num", "chain.0.den.1"))
    assert found.agreeing >= 3
    assert found.cost.min() == 0.0


def test_nothing_to_fit_is_said():
    with pytest.raises(WhidError, match="estimation"):
        refine(CURVE, [replace(recorded(CURVE, np.ones(20)), use="report")])


def test_estimate_of_a_tree_names_its_numbers():
    found = refine(CURVE, [recorded(CURVE, np.linspace(-1, 1, 50))])
    assert isinstance(found.estimate, Estimate)
    assert found.estimate.names == tuple(p.name for p in Chain(chain=CURVE.chain).parameters())
    assert "residual rms" in found.table().columns


def test_averaged_periods_give_the_answer_of_the_time_fit():
    """Settled periods alone, in time and in sufficient statistics: the same numbers to 1e-8."""
    parts = (
        Sine(offset=0.2, amplitude=1.5, period=120.0, periods=30, lead_periods=5, start=0, stop=4200),
        Sine(offset=0.1, amplitude=1.0, period=60.0, periods=20, lead_periods=10, start=4200, stop=6000),
    )
    rng = np.random.default_rng(23)
    u = np.concatenate([part.input(0.1, rng) for part in parts])
    record = recorded(HARD, u, noise=0.01, seed=24, parts=parts)
    settled = np.ones(6000, bool)
    settled[:600] = settled[4200:4800] = False
    start = replace(HARD, chain=(replace(HARD.chain[0], den=(0.85, 1.45, 1.0)), *HARD.chain[1:]))
    in_time = refine(start, [replace(record, valid=settled)], fixed=UNIT)
    averaged = refine(start, [record], fixed=UNIT, periodic=True)
    np.testing.assert_allclose(averaged.estimate.values, in_time.estimate.values, rtol=1e-8)
    np.testing.assert_allclose(averaged.estimate.std, in_time.estimate.std, rtol=1e-7)
    np.testing.assert_allclose(averaged.rms, in_time.rms, rtol=1e-8)
    assert averaged.samples.tolist() == in_time.samples.tolist() == [4800.0]
    assert averaged.estimate.dof == in_time.estimate.dof


PERIOD = 1.5 * np.sin(2 * np.pi * (np.arange(120) + 7.37) / 120)
JUMPS_FIRST = System(chain=(Piecewise(breaks=(PERIOD[0],), pieces=((-0.4, 1.0), (0.2, 0.8))), *HARD.chain[2:]))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("intersample", ["discrete", "zoh", "foh"])
@pytest.mark.parametrize("system", [HARD, JUMPS_FIRST], ids=["between filters", "met at the period's first sample"])
def test_a_period_starts_in_the_state_that_it_leads_back_to(system, intersample, sign):
    """Residual and tangents of the one period are those of the last of many from rest, a jump at its border included."""
    part = Sine(offset=0.0, amplitude=1.5, period=120.0, periods=8, start=0, stop=960)
    u = np.tile(PERIOD if sign > 0 else 2 * PERIOD[0] - PERIOD, 8)
    record = Record(u=u, y=np.zeros(960), dt=0.1, intersample=intersample, parts=(part,))
    (averaged,) = periodic(Data.of(record, system.tree), system.tree)
    late = replace(record, valid=np.arange(960) // 120 == 6)
    free = FreeNumbers(system.tree)
    one, many = Problem(free, (averaged,)), Problem(free, data_of([late], system.tree))
    assert averaged.last == 120
    np.testing.assert_allclose(one.residuals(one.start)[0][:120], many.residuals(many.start)[0][720:840], atol=1e-12)
    rows = [np.concatenate(list(problem._rows(problem.start, tangents=True))) for problem in (one, many)]
    np.testing.assert_allclose(rows[0] / np.sqrt(averaged.periods), rows[1], atol=1e-11)


def test_a_filter_that_keeps_what_it_gets_has_no_periodic_state():
    """An unstable trial is no model, and an integrator's periods are simulated from rest."""
    system = System(chain=(Linear(num=(1.0,), den=(1.0, 0.3)),))
    part = Sine(offset=0.0, amplitude=1.0, period=60.0, periods=5, start=0, stop=300)
    record = recorded(system, part.input(0.1, np.random.default_rng(1)), noise=0.01, parts=(part,))
    problem = Problem(FreeNumbers(system.tree), tuple(periodic(data_of([record], system.tree)[0], system.tree)))
    assert np.isfinite(problem.cost(problem.start))
    assert problem.cost(np.array([1.0, 1.0, -0.3])) == np.inf
    ramp = System(chain=(Linear(num=(1.0,), den=(1.0, 0.0)),)).tree
    assert not any(data.returns for data in periodic(data_of([record], ramp)[0], ramp))


@pytest.mark.parametrize("intersample", ["discrete", "zoh", "foh"])
def test_a_trial_s_signals_serve_its_linearisation_and_nothing_else(intersample):
    """The same numbers to the last bit as without a trial before, or with one elsewhere; nothing is kept afterwards."""
    front, back = Linear(num=(1.0,), den=(0.5, 0.4, 1.0)), Linear(num=(0.3, 1.0), den=(0.5, 1.0))
    tree = System(chain=(front, DeadZone(low=-0.4, high=0.6), back)).tree
    u = 1.5 * np.random.default_rng(11).normal(size=40_000).cumsum() / 30
    data = Record(u=u, y=0.9 * np.tanh(u), dt=0.1, intersample=intersample, initial="steady")
    start = Problem(FreeNumbers(tree), data_of([data], tree)).start

    def linearised(*trials):
        problem = Problem(FreeNumbers(tree), data_of([data], tree))
        costs = [problem.cost(factor * start) for factor in trials]
        before = len(problem.data[0].kept)
        found = problem.linearise(1.01 * start)
        assert len(problem.data[0].kept) == 0
        return found, costs, before

    alone, _, nothing = linearised()
    tried, costs, kept = linearised(0.97, 1.01)
    elsewhere, *_ = linearised(1.01, 0.97)
    assert nothing == 0 < kept
    for other in (tried, elsewhere):
        np.testing.assert_array_equal(alone.r, other.r)
        np.testing.assert_array_equal(alone.projected, other.projected)
    assert costs[-1] == pytest.approx(alone.chi2, rel=1e-12)


def test_a_long_record_s_signals_are_not_kept():
    lag = Linear(num=(1.0,), den=(1.0, 1.0))
    u = np.random.default_rng(12).normal(size=KEPT + 1)
    problem = Problem(FreeNumbers(lag), data_of([Record(u=u, y=u, dt=0.1)], lag))
    problem.cost(problem.start)
    assert len(problem.data[0].kept) == 0
