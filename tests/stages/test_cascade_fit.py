"""Filter, curve, filter on samples: against scipy's filters and finite differences; splits, descent, aliasing."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.blocks.spline import Spline
from whid.blocks.table import Table
from whid.stages._cascade import Cascade, Filter, filtered, from_delta, monic_rates
from whid.stages._forms import on
from whid.stages.allocation import allocation
from whid.stages.between_samples import between_samples
from whid.stages.cascade_fit import Window, cascade_fit, errors, knotted, reached, rms_error

FRONT_ROOTS = (np.array([-0.3 + 0j]), np.array([0.7 + 0.3j, 0.7 - 0.3j]))
BACK_ROOTS = (np.array([0.1 + 0.9j, 0.1 - 0.9j]), np.array([0.6 + 0.5j, 0.6 - 0.5j, 0.5]))
FRONT, BACK = Filter.of_roots(*FRONT_ROOTS), Filter.of_roots(*BACK_ROOTS)
KNOTS = np.array([-3.0, -1.5, -0.5, 0.2, 1.0, 2.5])
HEIGHTS = np.array([-2.2, -1.4, -0.5, 0.2, 0.7, 0.8])
CURVE = Spline(inputs=tuple(KNOTS), outputs=tuple(HEIGHTS))
TRUE = Cascade((FRONT, CURVE, BACK))


def noise(samples, seed):
    return np.random.default_rng(seed).standard_normal(samples)


def window(samples=6000, std=0.01, seed=1):
    u = noise(samples, seed)
    return Window(u, TRUE.response(u) + std * noise(samples, seed + 1), np.arange(samples) >= 50)


def test_spline_is_scipys_natural_one():
    v = np.linspace(KNOTS[0], KNOTS[-1], 301)
    reference = CubicSpline(KNOTS, HEIGHTS, bc_type="natural")
    np.testing.assert_allclose(CURVE.value(v), reference(v), atol=1e-13)
    np.testing.assert_allclose(CURVE.derivative(v), reference(v, 1), atol=1e-12)
    outside = np.array([-5.0, 4.0])
    ends = KNOTS[[0, -1]]
    np.testing.assert_allclose(CURVE.value(outside), reference(ends) + reference(ends, 1) * (outside - ends), atol=1e-12)
    everywhere = np.concatenate([v, outside])
    np.testing.assert_allclose(CURVE.basis(everywhere) @ HEIGHTS, CURVE.value(everywhere), atol=1e-12)


def test_response_is_that_of_scipys_filters():
    u = np.concatenate([np.zeros(1), noise(300, 3)])
    num, den = (np.real(np.poly(r)) for r in FRONT_ROOTS)
    v = lfilter(num / num.sum() * den.sum(), den, u)
    num, den = (np.real(np.poly(r)) for r in BACK_ROOTS)
    w = CURVE.value(v)
    level = w[0]  # both are steady before the first sample
    y = level + lfilter(num / num.sum() * den.sum(), den, w - level)
    np.testing.assert_allclose(TRUE.response(u), y, atol=1e-12)


def test_delta_is_its_own_inverse_and_the_block_the_same_filter():
    c = np.array([1.0, -0.4, 3.0, 2.0])
    np.testing.assert_allclose(from_delta(from_delta(c)), c, atol=1e-13)
    block = BACK.block(0.1)
    x = noise(200, 4)
    ours = filtered(BACK.num_z, BACK.den_z, np.concatenate([[0.0], x]))[1:]
    np.testing.assert_allclose(block(x, 0.1, "discrete"), ours, atol=1e-12)


@pytest.mark.parametrize(
    "parts",
    [
        (FRONT, CURVE, BACK),
        (FRONT, Table(inputs=tuple(KNOTS), outputs=tuple(HEIGHTS)), BACK),
        (CURVE, BACK, Table(inputs=(-1.0, 0.1, 1.0), outputs=(-0.5, 0.0, 1.0), knee=0.3)),
        (FRONT, Saturation(low=-0.5, high=0.4, knee=0.2, fix=("slope",)), Polynomial(coefficients=(0.1, 2.0)), BACK),
    ],
    ids=["filter-curve-filter", "hinges", "curve-filter-curve", "saturation"],
)
def test_tangents_are_finite_differences(parts):
    cascade = Cascade(parts)
    u, theta = noise(200, 5), cascade.values
    y, rates = cascade.tangents(u)
    np.testing.assert_allclose(y, cascade.response(u), atol=1e-13)
    for k in range(len(theta)):
        step = 1e-7 * np.eye(len(theta))[k]
        difference = (cascade.replaced(theta + step).response(u) - cascade.replaced(theta - step).response(u)) / 2e-7
        assert np.abs(difference - rates[k]).max() < 1e-6 * max(1.0, np.abs(rates[k]).max())


def test_rates_of_the_monic_coefficients():
    own = np.concatenate(BACK)
    rates = monic_rates(BACK)
    for k in range(len(own)):
        moved = own + 1e-6 * np.eye(len(own))[k]
        block, base = Filter(*np.split(moved, [len(BACK.num)])).block(1.0), BACK.block(1.0)
        difference = (np.array([*block.num, *block.den]) - np.array([*base.num, *base.den])) / 1e-6
        np.testing.assert_allclose(rates[:, k], difference, atol=1e-4 * np.abs(difference).max())


def test_the_right_split_comes_first():
    zeros, poles = (np.concatenate([a, b]) for a, b in zip(FRONT_ROOTS, BACK_ROOTS, strict=True))
    w = window(std=1e-3)
    found = allocation(w.u, w.y, w.use, [(zeros, poles)], None)
    best = found.best[0]
    np.testing.assert_allclose(np.concatenate(best.front), np.concatenate(FRONT), atol=1e-9)
    assert len(found.rms) > 5
    assert found.rms[found.front_poles != 2].min() > 3 * found.rms[0]
    assert found.linear > 3 * found.rms[0]


def test_descent_reaches_the_noise_and_its_errors_hold():
    w = window()
    start = TRUE.replaced(TRUE.values * (1 + 0.05 * noise(len(TRUE.values), 7)))
    cascade, estimate = cascade_fit([w], start)
    assert rms_error([w], cascade) == pytest.approx(0.01, rel=0.03)
    z = (estimate.values - TRUE.values) / estimate.std
    assert np.mean(z**2) < 1 + 4 * np.sqrt(2 / len(z))


def test_a_filter_does_not_learn_the_drift_of_its_window():
    """A lag of four samples and a ramp: with two poles to spend one would settle for half a million samples."""
    u = noise(400, 9) + 1
    lag = Filter.of_roots(np.empty(0), np.array([0.8 + 0j]))
    y = lag.through(u) + np.linspace(0, 1.5, 400) + 0.1 * noise(400, 10)
    start = Cascade((Filter.of_roots(np.array([0.5 + 0j]), np.array([0.8 + 0j, 0.98])), Polynomial(coefficients=(0.0, 1.0))))
    found, _ = cascade_fit([Window(u, y, np.arange(400) >= 20)], start, 60)
    assert found.slowest <= 400
    assert start.slowest == pytest.approx(-1 / np.log(0.98))


def test_windows_count_together():
    w = window()
    halves = [Window(w.u[:3050], w.y[:3050], w.use[:3050]), Window(w.u[3000:], w.y[3000:], np.arange(3000) >= 50)]
    together, _ = cascade_fit(halves, TRUE)
    whole, estimate = cascade_fit([w], TRUE)
    np.testing.assert_allclose(together.values, whole.values, atol=0.05 * estimate.std.max())
    assert [len(e) for e in errors(halves, TRUE)] == [3000, 2950]


def test_knots_go_where_the_curve_bends():
    knee = Cascade((FRONT, Table(inputs=(-3.0, 0.0, 0.3, 3.0), outputs=(-3.0, 0.0, 0.15, 0.2)), BACK))
    u = np.linspace(-3.0, 3.0, 50)
    still = Cascade((knee.parts[1],))  # a curve alone: the levels that arrive are the input's
    placed = np.array(knotted([Window(u, u, u < 9)], still, 12).curves[0].inputs)
    np.testing.assert_allclose(placed[[0, -1]], [-3.0, 3.0])
    assert np.sum((placed > -0.4) & (placed < 0.7)) >= 5


def test_knots_do_not_crowd_where_hardly_a_sample_goes():
    """A wiggle that sixty samples made at the end of the curve bends more than all the rest: two knots of thirty."""
    levels = np.concatenate([np.clip(noise(20_000, 11) * 0.6, -1.8, 1.8), np.linspace(1.8, 2.2, 60)])
    points = np.append(np.linspace(-2.2, 1.8, 9), [1.9, 2.0, 2.1, 2.2])
    curve = Spline(
        inputs=tuple(points), outputs=tuple(np.tanh(points) + np.where(points > 1.85, 0.3 * (-1) ** np.arange(13), 0))
    )
    inputs = np.array(on(curve, levels, 30, by_bend=True).inputs)
    assert len(inputs) == 30
    assert inputs[[0, -1]] == pytest.approx([levels.min(), levels.max()])
    assert np.sum(inputs[:-1] > 1.8) <= 2
    seen = np.histogram(levels, inputs)[0]
    assert np.sum(seen[:-1] < 25) <= 1  # the first interval begins where the samples do


def test_hinges_find_a_knee_between_their_knots():
    u = noise(8000, 8)
    true = Cascade((FRONT, Table(inputs=(-4.0, 0.37, 4.0), outputs=(-4.0, 0.37, 1.0)), BACK))
    w = Window(u, true.response(u) + 1e-3 * noise(8000, 9), np.arange(8000) >= 50)
    start = Cascade((FRONT, Table(inputs=(-4.0, 0.0, 4.0), outputs=(-4.0, 0.1, 1.0)), BACK))
    found, _ = cascade_fit([w], start, max_iterations=60)
    assert found.curves[0].inputs[1] == pytest.approx(0.37, abs=0.005)
    assert rms_error([w], found) == pytest.approx(1e-3, rel=0.05)


def test_a_model_at_the_record_rate_predicts_its_own_aliasing():
    """A chain run at eight times the rate is nearly analogue; its fit at the record's rate leaves the aliasing."""
    front = Filter.of_roots(np.empty(0), 0.97 * np.exp(np.array([0.12j, -0.12j])))
    back = Filter.of_roots(np.empty(0), np.array([0.95 + 0j]))
    samples, factor = 8000, 8
    spectrum = np.fft.rfft(noise(samples, 10))
    spectrum[int(0.4 * samples) :] = 0
    fine = np.fft.irfft(spectrum, samples * factor) * factor
    v = front.through(fine)
    curve = Table(inputs=(-1.0, 0.0, 1.0), outputs=(-1.0, 0.0, 0.0))
    y = filtered(back.num_z, back.den_z, curve.value(v / v.std()))[::factor]
    turn = np.linspace(0.01, 2.4, 200)
    from whid.stages.linear_fit import matched

    slow = matched(front.at(turn / factor), turn, 4, 4), matched(back.at(turn / factor), turn, 4, 4)
    scaled = Table(inputs=tuple(float(v.std()) * x for x in (-1.0, 0.0, 1.0)), outputs=curve.outputs)
    w = Window(fine[::factor], y + 1e-4 * noise(samples, 11), np.arange(samples) >= 200)
    cascade, _ = cascade_fit([w], Cascade((slow[0], scaled, slow[1])))
    found = between_samples(w, cascade, 1.0)
    assert found.present
    assert found.coefficient == pytest.approx(1.0, abs=0.35)
    straight = Cascade((cascade.parts[0], Table(inputs=(-1.0, 1.0), outputs=(-1.0, 1.0)), cascade.parts[2]))
    linear = w._replace(y=straight.response(w.u) + 1e-4 * noise(samples, 12))
    assert not between_samples(linear, straight, 1.0).present
    assert reached([w], cascade)[0][0] < -1
