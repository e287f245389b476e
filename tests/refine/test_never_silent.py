"""Trees, records and starts that are hard on a fit: each ends in a result that says what happened, or in a named refusal."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from whid.blocks.chain import Chain
from whid.blocks.delay import Delay
from whid.blocks.feedback import Feedback
from whid.blocks.linear import Linear
from whid.blocks.parallel import Parallel
from whid.blocks.polynomial import Polynomial
from whid.blocks.quantizer import Quantizer
from whid.blocks.relay import Relay
from whid.blocks.saturation import Saturation
from whid.errors import WhidError
from whid.predict import predict
from whid.record import Record
from whid.refine import refine
from whid.refine._problem import Problem
from whid.system import System

LAG = Linear(num=(1.0,), den=(0.5, 1.0), fix=("num",))
CURVED = System(chain=(LAG, Polynomial(coefficients=(0.0, 1.0, 0.2))))
U = np.repeat(np.random.default_rng(0).normal(size=60), 10) * 1.5
GAIN = ("chain.0.den.1",)


@pytest.fixture(autouse=True)
def _no_warning_reaches_a_user():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def recorded(system, u=U, dt=0.1, noise=0.01, seed=1, **given):
    record = Record(u=u, y=np.zeros(len(u)), dt=dt, **given)
    return replace(record, y=predict(system.tree, record) + noise * np.random.default_rng(seed).normal(size=len(u)))


def started(system, **numbers):
    values = {name.replace("_", "."): value for name, value in numbers.items()}
    return replace(system, chain=system.tree.with_parameters(values).chain)


def assert_true(found, system, noise=0.01):
    """Every number within five standard errors, the residual the noise."""
    truth = {p.name: p.value for p in system.tree.parameters(held=True)}
    e = found.estimate
    z = [(v - truth[n]) / s for n, v, s in zip(e.names, e.values, e.std, strict=True)]
    assert np.abs(z).max() < 5, dict(zip(e.names, z, strict=True))
    assert found.rms == pytest.approx(noise, rel=5 / np.sqrt(2 * found.samples.min()))
    assert e.why_stop in ("converged", "small step")


def test_parallel_branches():
    cubic = Chain(chain=(Linear(num=(1.0,), den=(0.2, 1.0)), Polynomial(coefficients=(0.0, 0.0, 0.0, 0.3))))
    tree = System(chain=(Parallel(parallel=(Linear(num=(1.0,), den=(0.5, 1.0)), cubic)),))
    found = refine(started(tree, chain_0_parallel_0_den_0=0.7), [recorded(tree)])
    assert_true(found, tree)
    assert any("gain may move between chain.0.parallel.1.chain.0" in text for text in found.gauge)


def test_a_loop_with_dynamics_and_a_static_one():
    back = Polynomial(coefficients=(0.0, 0.5, 0.1), fix=True)
    loop = System(chain=(Feedback(forward=Linear(num=(2.0,), den=(0.5, 1.0)), back=back),))
    held = ("chain.0.forward.den.1",)
    assert_true(refine(started(loop, chain_0_forward_den_0=0.6), [recorded(loop, U[:80])], fixed=held), loop)
    static = System(chain=(LAG, Feedback(forward=Polynomial(coefficients=(0.0, 2.0, 0.0, 0.3)), solve="algebraic")))
    held = (*GAIN, "chain.1.forward.coefficients.0", "chain.1.forward.coefficients.2")
    assert_true(refine(started(static, chain_0_den_0=0.6), [recorded(static)], fixed=held), static)


def test_switches_are_fitted_through_their_impulses_and_hide_what_they_hide():
    steps = System(chain=(LAG, Quantizer(step_=0.4), LAG))
    relay = System(chain=(LAG, Relay(low=-0.4, high=0.3, off=-1.0, on=2.0), LAG))
    held = (*GAIN, "chain.2.den.1")
    assert_true(refine(started(steps, chain_0_den_0=0.55), [recorded(steps)], fixed=held), steps)
    assert_true(refine(started(relay, chain_1_high=0.33, chain_1_on=1.5), [recorded(relay)], fixed=held), relay)
    last = System(chain=(LAG, Quantizer(step_=0.2)))  # no block behind it sees when it switches
    found = refine(started(last, chain_0_den_0=0.6), [recorded(last)], fixed=GAIN)
    assert "the data do not determine chain.0.den.0" in found.gauge
    assert "chain.1 (quantizer) hides small changes of what is ahead of it: their derivative is 0" in found.gauge
    assert np.isinf(found.estimate.std[0])


def test_a_number_at_its_bound_is_said():
    tree = System(chain=(LAG, Delay(seconds=0.0)))
    record = recorded(tree)
    early = replace(record, y=np.append(record.y[1:], 0.0))  # the output comes before the input: no delay is small enough
    found = refine(started(tree, chain_1_seconds=0.17), [early], fixed=GAIN)
    assert found.estimate.value("chain.1.seconds") == 0.0
    assert any("chain.1.seconds stopped at its bound, 0" in text for text in found.gauge)
    assert "stopped at its bound" in "".join(found.table().notes)


def test_trial_steps_that_explode_or_make_no_block_are_taken_back(monkeypatch):
    """From a lag a hundred times too slow a step makes the pole unstable."""
    tried, cost = [], Problem.cost
    monkeypatch.setattr(Problem, "cost", lambda self, theta: tried.append(cost(self, theta)) or tried[-1])
    fast = System(chain=(replace(LAG, den=(0.05, 1.0)), Saturation(low=-0.8, high=1.0, fix=("slope",))))
    found = refine(started(fast, chain_0_den_0=5.0, chain_1_low=-0.01, chain_1_high=0.01), [recorded(fast)], fixed=GAIN)
    assert np.isinf(tried).any()
    assert_true(found, fast)


@pytest.mark.parametrize(
    ("system", "record", "code"),
    [
        (started(CURVED, chain_0_den_1=-200.0), recorded(CURVED), "fit-start"),  # unstable
        (CURVED, replace(recorded(CURVED), u=np.where(np.arange(600) == 7, np.nan, U)), "fit-start"),
        (CURVED, replace(recorded(CURVED), u=np.where(np.arange(600) == 7, np.inf, U)), "fit-start"),
        (CURVED, replace(recorded(CURVED), y=np.full(600, 1e300)), "fit-start"),
        (CURVED, replace(recorded(CURVED), y=np.full(600, np.nan)), "fit-no-data"),
        (CURVED, replace(recorded(CURVED), initial="steady"), ""),
        (System(chain=(Linear(num=(1.0,), den=(1.0, 0.0)),)), recorded(CURVED, initial="steady"), "block-no-steady-state"),
        (System(chain=(Linear(num=(0.1,), den=(1.0, -0.9), dt=0.3),)), recorded(CURVED), "block-parameters"),
    ],
)
def test_what_cannot_be_fitted_is_refused_by_name(system, record, code):
    if not code:
        assert refine(system, [record], fixed=GAIN).estimate.why_stop == "converged"
        return
    with pytest.raises(WhidError) as fault:
        refine(system, [record])
    assert fault.value.code == code


def test_missing_outputs_are_skipped():
    record = recorded(CURVED)
    y = record.y.copy()
    y[5:50] = np.nan
    found = refine(CURVED, [replace(record, y=y)], fixed=GAIN)
    assert found.samples.tolist() == [555.0]
    assert_true(found, CURVED)


def test_records_of_different_sampling_times_are_fitted_together():
    records = [recorded(CURVED, name="slow"), recorded(CURVED, np.repeat(U, 2), dt=0.05, seed=2, name="fast")]
    both = refine(started(CURVED, chain_0_den_0=0.6), records, fixed=GAIN)
    assert_true(both, CURVED)
    assert both.record == ("slow", "fast")
    alone = refine(CURVED, records[:1], fixed=GAIN)
    assert np.all(both.estimate.std < alone.estimate.std)


def test_nothing_left_over_and_nothing_to_tell():
    exact = refine(started(CURVED, chain_0_den_0=0.6), [recorded(CURVED, noise=0.0)], fixed=GAIN)
    assert exact.estimate.why_stop == "converged"  # at rounding, not at the iteration limit
    assert exact.estimate.iterations < 15
    few = refine(CURVED, [recorded(CURVED, U[:3])], fixed=GAIN)
    assert np.isinf(few.estimate.std).all()
    assert "3 samples for 3 numbers: nothing is left to tell errors from" in few.gauge
    silent = refine(CURVED, [recorded(CURVED, np.zeros(50))], fixed=GAIN)
    assert "the data do not determine chain.0.den.0, chain.1.coefficients.1, chain.1.coefficients.2" in silent.gauge


def test_units_make_no_difference():
    """u in thousandths, y in millions: the same fit, number by number, in other units."""
    lag = replace(LAG, fix=("num", "den.1"))
    plain = refine(started(CURVED, chain_0_den_0=0.7), [recorded(CURVED)], fixed=GAIN)
    record = recorded(CURVED)
    scaled = replace(record, u=record.u * 1e3, y=record.y * 1e-6)
    start = System(chain=(replace(lag, den=(0.7, 1.0)), Polynomial(coefficients=(0.0, 1e-9, 0.2e-12))))
    found = refine(start, [scaled], fixed=GAIN)
    ratio = found.estimate.values[[0, 2, 3]] / plain.estimate.values[[0, 2, 3]]
    np.testing.assert_allclose(ratio, [1.0, 1e-9, 1e-12], rtol=1e-5)
    errors = found.estimate.std / plain.estimate.std
    np.testing.assert_allclose(errors, [1.0, 1e-6, 1e-9, 1e-12], rtol=1e-4)


def test_the_result_shows_correlation_and_chi2():
    record = recorded(CURVED)
    learnt, known = refine(CURVED, [record], fixed=GAIN), refine(CURVED, [record], fixed=GAIN, std=[0.02])
    e = known.estimate
    assert known.estimate.reduced_chi2 == pytest.approx((learnt.rms[0] / 0.02) ** 2 * 600 / (600 - 4), rel=1e-6)
    assert f"χ²/dof {e.reduced_chi2:.3g}" in known.table().notes[0]
    assert "noise std from the residual" in learnt.table().notes[0]
    np.testing.assert_allclose(np.diag(e.correlation), 1.0)
    largest = np.abs(np.tril(e.correlation, -1)).max()
    assert f"largest correlation {largest:.3f}" in known.table().notes[1].replace("-", "")
    design = np.corrcoef(np.random.default_rng(3).multivariate_normal(e.values, e.covariance, 20_000).T)
    np.testing.assert_allclose(design, e.correlation, atol=0.03)
