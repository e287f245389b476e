"""Least squares against certified results [NIST StRD], scipy, the normal equations, and Monte Carlo."""

import numpy as np
import pytest
import scipy.optimize

from whid.fit import Parameter, Triangle, _Directions, least_squares, linear_least_squares, minimise

MISRA1A = np.array(
    [
        (77.6, 10.07), (114.9, 14.73), (141.1, 17.94), (190.8, 23.93), (239.9, 29.61), (289.0, 35.18), (332.8, 40.02),
        (378.4, 44.82), (434.8, 50.76), (477.3, 55.05), (536.8, 61.01), (593.1, 66.40), (689.1, 75.47), (760.0, 81.78),
    ]
).T  # fmt: skip
THURBER = np.array(
    [
        (-3.067, 80.574), (-2.981, 84.248), (-2.921, 87.264), (-2.912, 87.195), (-2.840, 89.076), (-2.797, 89.608),
        (-2.702, 89.868), (-2.699, 90.101), (-2.633, 92.405), (-2.481, 95.854), (-2.363, 100.696), (-2.322, 101.060),
        (-1.501, 401.672), (-1.460, 390.724), (-1.274, 567.534), (-1.212, 635.316), (-1.100, 733.054), (-1.046, 759.087),
        (-0.915, 894.206), (-0.714, 990.785), (-0.566, 1090.109), (-0.545, 1080.914), (-0.400, 1122.643),
        (-0.309, 1178.351), (-0.109, 1260.531), (-0.103, 1273.514), (0.010, 1288.339), (0.119, 1327.543),
        (0.377, 1353.863), (0.790, 1414.509), (0.963, 1425.208), (1.006, 1421.384), (1.115, 1442.962), (1.572, 1464.350),
        (1.841, 1468.705), (2.047, 1447.894), (2.200, 1457.628),
    ]
).T  # fmt: skip


def misra(b, x):
    return b[0] * (1 - np.exp(-b[1] * x))


def misra_tangent(b, x):
    return np.stack([1 - np.exp(-b[1] * x), b[0] * x * np.exp(-b[1] * x)], axis=1)


def thurber(b, x):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def thurber_tangent(b, x):
    powers = x[:, None] ** np.arange(4)
    bottom = 1 + powers[:, 1:] @ b[4:]
    return np.hstack([powers, -(thurber(b, x)[:, None]) * powers[:, 1:]]) / bottom[:, None]


PROBLEMS = {
    "Misra1a far": (
        MISRA1A, misra, misra_tangent, [500.0, 1e-4], [2.3894212918e02, 5.5015643181e-04],
        [2.7070075241, 7.2668688436e-06], 1.2455138894e-01,
    ),
    "Misra1a near": (
        MISRA1A, misra, misra_tangent, [250.0, 5e-4], [2.3894212918e02, 5.5015643181e-04],
        [2.7070075241, 7.2668688436e-06], 1.2455138894e-01,
    ),
    "Thurber far": (
        THURBER, thurber, thurber_tangent, [1000.0, 1000.0, 400.0, 40.0, 0.7, 0.3, 0.03],
        [1288.1396800, 1491.0792535, 583.23836877, 75.416644291, 0.96629502864, 0.39797285797, 0.049727297349],
        [4.6647963344, 3.9571156086e01, 2.8698696102e01, 5.5675370270, 3.1333340687e-02, 1.4984928198e-02, 6.5842344623e-03],
        5.6427082397e03,
    ),
}  # fmt: skip


def fitted(data, model, tangent, start, weights=None, **options):
    x, y = data
    parameters = [Parameter(f"b{k}", value) for k, value in enumerate(start)]
    return least_squares(lambda b: model(b, x) - y, lambda b: tangent(b, x), parameters, weights, **options)


@pytest.mark.parametrize("name", PROBLEMS)
def test_certified_values(name):
    data, model, tangent, start, values, std, rss = PROBLEMS[name]
    fit = fitted(data, model, tangent, start)
    np.testing.assert_allclose(fit.values, values, rtol=1e-7)
    np.testing.assert_allclose(fit.std, std, rtol=1e-6)
    assert fit.chi2 == pytest.approx(rss, rel=1e-9)
    assert fit.rank == len(values)
    assert fit.dof == data.shape[1] - len(values)
    assert fit.why_stop == "converged"


def test_the_same_minimum_as_scipy_with_weights():
    x, y = MISRA1A
    sigma = np.linspace(0.05, 0.2, len(x))
    fit = fitted(MISRA1A, misra, misra_tangent, [300.0, 4e-4], 1 / sigma)
    reference, covariance = scipy.optimize.curve_fit(
        lambda x, a, b: misra((a, b), x), x, y, [240.0, 5e-4], sigma, absolute_sigma=True, xtol=1e-14, ftol=1e-14
    )
    np.testing.assert_allclose(fit.values, reference, rtol=1e-6)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-4)
    other = scipy.optimize.least_squares(
        lambda b: (misra(b, x) - y) / sigma, [240.0, 5e-4], x_scale=[100, 1e-4], xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    assert fit.chi2 == pytest.approx(2 * other.cost, rel=1e-9)


def test_covariance_is_what_repeats_scatter():
    """2000 repeats: a variance ratio has standard error √(2/2000) = .032; five of those. The pulls cover 95 %."""
    rng, t, truth, sigma = np.random.default_rng(8), np.linspace(0, 5, 30), np.array([2.0, 0.7]), 0.02
    estimates, pulls = [], []
    for _ in range(2000):
        data = np.array([t, truth[0] * np.exp(-truth[1] * t) + sigma * rng.standard_normal(30)])
        fit = fitted(
            data, lambda b, x: b[0] * np.exp(-b[1] * x),
            lambda b, x: np.stack([np.exp(-b[1] * x), -b[0] * x * np.exp(-b[1] * x)], 1), [1.5, 1.0], np.full(30, 1 / sigma),
        )  # fmt: skip
        estimates.append(fit.values)
        pulls.append((fit.values - truth) / fit.std)
    np.testing.assert_allclose(np.cov(np.array(estimates).T).diagonal() / np.diag(fit.covariance), 1.0, atol=0.16)
    correlation = np.corrcoef(np.array(estimates).T)[0, 1]
    assert correlation == pytest.approx(fit.covariance[0, 1] / np.prod(fit.std), abs=0.05)
    assert np.mean(np.abs(pulls) < 1.96, axis=0) == pytest.approx([0.95, 0.95], abs=0.025)


def test_bounds_hold_and_the_rest_is_fitted():
    x, y = MISRA1A
    parameters = [Parameter("b0", 200.0, upper=230.0), Parameter("b1", 5e-4)]
    fit = least_squares(lambda b: misra(b, x) - y, lambda b: misra_tangent(b, x), parameters)
    reference = scipy.optimize.least_squares(
        lambda b: misra(b, x) - y,
        [200.0, 5e-4],
        bounds=([-np.inf] * 2, [230.0, np.inf]),
        x_scale=[100, 1e-4],
        xtol=1e-15,
        ftol=1e-15,
    )
    assert fit.values[0] == 230.0
    assert fit.chi2 == pytest.approx(2 * reference.cost, rel=1e-6)
    assert fit.why_stop == "converged"
    pinned = [Parameter("b0", 230.0, lower=230.0, upper=230.0), Parameter("b1", 5e-4, lower=5e-4, upper=5e-4)]
    fit = least_squares(lambda b: misra(b, x) - y, lambda b: misra_tangent(b, x), pinned)
    assert fit.values.tolist() == [230.0, 5e-4]


def descend(residual, tangent, start, idle_gain=1e-2):
    """The engine as the whole-record fit uses it, one number."""
    return minimise(
        lambda b: float(residual(b) @ residual(b)), lambda b: Triangle.of(tangent(b), residual(b)),
        [Parameter("b", start)], tolerance=0.0, idle_gain=idle_gain,
    )  # fmt: skip


def test_a_slow_end_at_the_minimum_has_converged_and_one_on_an_edge_has_not():
    """At the minimum, reached by steps that gain less and less; and a slope that promises what no step delivers."""

    def slow(b):  # large residual, Gauss-Newton converges linearly: (b, 50 + b²/30)
        return np.array([b[0], 50 + b[0] ** 2 / 30])

    fit = descend(slow, lambda b: np.array([[1.0], [b[0] / 15]]), 0.5)
    assert fit.why_stop == "converged"
    assert fit.iterations < 20
    assert abs(fit.values[0]) < 0.1  # standard errors
    promised = descend(lambda b: np.array([2.0 + 1e-4 * abs(b[0] - 1)]), lambda b: np.array([[1.0]]), 1.0)
    assert promised.why_stop != "converged"
    edge = descend(lambda b: np.array([2.0, np.floor(1e3 * b[0]) / 1e3]), lambda b: np.array([[0.5], [1.0]]), 0.0)
    assert edge.why_stop != "converged"


def test_a_decrement_is_what_is_left_to_the_minimum():
    """λ² of a straight problem is χ² − χ²(minimum), and no number is further than λ standard errors from it."""
    rng = np.random.default_rng(12)
    design, data = rng.standard_normal((30, 3)), rng.standard_normal(30)
    best = linear_least_squares(design, data, np.ones(30))
    theta = best.values + rng.standard_normal(3) * best.std
    gain = _Directions.of(Triangle.of(design, design @ theta - data)).gain
    assert gain == pytest.approx(np.sum((design @ theta - data) ** 2) - best.chi2, rel=1e-9)
    assert np.all(np.abs(theta - best.values) <= np.sqrt(gain) * best.std)


def test_a_start_outside_its_bounds_is_brought_inside():
    fit = fitted(MISRA1A, misra, misra_tangent, [240.0, 5e-4])
    assert fit.why_stop == "converged"
    bounded = least_squares(
        lambda b: b - 3.0, lambda b: np.eye(1), [Parameter("x", 100.0, lower=0.0, upper=10.0)], np.ones(1)
    )
    assert bounded.values[0] == pytest.approx(3.0)


@pytest.mark.parametrize("linear", [True, False])
def test_two_equal_columns_are_one_direction_and_named(linear):
    rng = np.random.default_rng(9)
    column, other = rng.standard_normal((2, 40))
    design, data = np.stack([column, other, column], axis=1), rng.standard_normal(40)
    if linear:
        fit = linear_least_squares(design, data, np.ones(40), ["a", "b", "c"])
    else:
        fit = least_squares(lambda p: design @ p - data, lambda p: design, [Parameter(n, 0.0) for n in "abc"], np.ones(40))
    assert fit.rank == 2
    np.testing.assert_allclose(np.abs(fit.null_directions), [[np.sqrt(0.5), 0, np.sqrt(0.5)]], atol=1e-9)
    assert np.isinf(fit.std[[0, 2]]).all()
    whole = np.linalg.lstsq(design[:, :2], data, rcond=None)[0]
    assert fit.value("a") + fit.value("c") == pytest.approx(whole[0], rel=1e-7)
    assert fit.value("b") == pytest.approx(whole[1], rel=1e-7)
    assert fit.std[1] == pytest.approx(np.sqrt(np.linalg.inv(design[:, :2].T @ design[:, :2])[1, 1]), rel=1e-9)


def test_columns_of_very_different_size_are_not_a_rank_defect():
    rng = np.random.default_rng(10)
    design = rng.standard_normal((50, 3)) * [1e-12, 1.0, 1e12]
    fit = linear_least_squares(design, design @ [1e12, 1.0, 1e-12], np.ones(50))
    assert fit.rank == 3
    np.testing.assert_allclose(fit.values * [1e-12, 1.0, 1e12], 1.0, rtol=1e-9)


def test_linear_is_the_normal_equations_and_fewer_data_than_parameters_are_a_rank_defect():
    rng = np.random.default_rng(11)
    design, data, sigma = rng.standard_normal((30, 4)), rng.standard_normal(30), rng.uniform(0.5, 2, 30)
    fit = linear_least_squares(design, data, 1 / sigma)
    weighted = design / sigma[:, None]
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(weighted.T @ weighted), rtol=1e-10)
    np.testing.assert_allclose(fit.values, fit.covariance @ weighted.T @ (data / sigma), rtol=1e-9)
    short = linear_least_squares(design[:2], data[:2], np.ones(2))
    assert short.rank == 2
    assert len(short.null_directions) == 2
    np.testing.assert_allclose(design[:2] @ short.values, data[:2], atol=1e-12)


def test_ctrl_c_keeps_the_best():
    x, y = MISRA1A
    calls, best = [], []

    def residual(b):
        calls.append(b)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return misra(b, x) - y

    fit = least_squares(
        residual, lambda b: misra_tangent(b, x), [Parameter("b0", 500.0), Parameter("b1", 1e-4)],
        watch=lambda iteration, chi2, b: best.append((chi2, tuple(b))),
    )  # fmt: skip
    assert fit.why_stop == "interrupted"
    assert (fit.chi2, tuple(fit.values)) == min(best)
    assert len(best) >= 1
    assert np.all(np.isfinite(fit.std))


def test_a_region_that_cannot_be_computed_is_walked_around():
    """√ of a negative number is NaN: a step there is refused, not taken."""
    fit = least_squares(
        lambda p: np.array([np.sqrt(p[0]) - 0.1, p[0] - 0.01]), lambda p: np.array([[0.5 / np.sqrt(p[0])], [1.0]]),
        [Parameter("p", 25.0)], np.ones(2),
    )  # fmt: skip
    assert fit.values[0] == pytest.approx(0.01, rel=1e-9)


def test_it_says_when_it_ran_out_of_iterations():
    assert fitted(MISRA1A, misra, misra_tangent, [500.0, 1e-4], max_iterations=2).why_stop == "iteration limit"


def test_a_problem_with_free_directions_converges_and_says_so():
    """Only a + b and c are seen: the minimum is reached, though no step determines a − b."""
    t = np.linspace(0.0, 3.0, 40)
    y = 2.0 * np.exp(-0.7 * t) + 0.01 * np.random.default_rng(20000).standard_normal(40)

    def residual(p):
        return (p[0] + p[1]) * np.exp(-p[2] * t) - y

    def tangent(p):
        e = np.exp(-p[2] * t)
        return np.stack([e, e, -t * (p[0] + p[1]) * e], axis=1)

    start = [Parameter("a", 1.0), Parameter("b", 0.5), Parameter("c", 0.3)]
    fit = least_squares(residual, tangent, start, np.full(40, 100.0))
    assert fit.why_stop == "converged"
    assert fit.rank == 2
    assert np.isinf(fit.std[:2]).all()
    assert np.isfinite(fit.std[2])


def test_an_interruption_goes_through_a_fit_that_nobody_watches():
    calls = []

    def slow(b):
        calls.append(b)
        if len(calls) > 2:
            raise KeyboardInterrupt
        return b - 3.0

    with pytest.raises(KeyboardInterrupt):
        least_squares(slow, lambda b: np.eye(1), [Parameter("b", 500.0)])
    assert len(calls) == 3
