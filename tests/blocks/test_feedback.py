"""Feedback against the closed loop's own equation."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from whid.blocks.chain import Chain
from whid.blocks.coulomb import Coulomb
from whid.blocks.feedback import Feedback
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.errors import WhidError
from whid.signal import held

U = np.random.default_rng(5).standard_normal(60)
INTEGRATOR = Linear(num=(1.0,), den=(1.0, 0.0))


def test_delayed_loop_is_its_recursion():
    plant = Linear(num=(0.3,), den=(1.0, -0.8), dt=0.5)
    y = Feedback(forward=plant, back=Polynomial(coefficients=(0.0, 0.5, 0.0, 0.1)))(U, 0.5, "discrete")
    expected, z = np.zeros(61), 0.0
    for n in range(60):  # y_{n+1} = 0.8 y_n + 0.3 e_n
        e = U[n] - z
        z = 0.5 * expected[n] + 0.1 * expected[n] ** 3
        expected[n + 1] = 0.8 * expected[n] + 0.3 * e
    np.testing.assert_allclose(y, expected[:60], atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_an_algebraic_linear_loop_is_the_closed_transfer_function(sign):
    """Digital: G = b(z)/a(z) with feedthrough gives b/(a ∓ k·b)."""
    num, den, k = np.array([0.5, 0.2]), np.array([1.0, -0.6]), 0.4
    loop = Feedback(
        forward=Linear(num=tuple(num), den=tuple(den), dt=0.5),
        back=Linear(num=(k,), den=(1.0,)),
        sign=sign,
        solve="algebraic",
    )
    closed = Linear(num=tuple(num), den=tuple(den - sign * k * num), dt=0.5)
    np.testing.assert_allclose(loop(U, 0.5, "discrete"), closed(U, 0.5, "discrete"), atol=1e-11)


def test_an_algebraic_static_loop_solves_its_equation():
    y = Feedback(forward=Polynomial(coefficients=(0.0, 0.0, 0.0, 1.0)), solve="algebraic")(U, 1.0)
    np.testing.assert_allclose(np.cbrt(y) + y, U, atol=1e-12)  # e = u − y, y = e³


def test_the_kinks_of_a_static_loop_are_met_between_samples():
    """Saturation at ±0.5 inside a loop of gain 1: y = clip(u/2, ±0.5); its integral along a ramp, by hand."""
    loop = Feedback(forward=Saturation(low=-0.5, high=0.5), solve="algebraic")
    u = held(np.array([0.0, 3.0, 3.0]), 1.0, "foh")
    y = Chain(chain=(loop, INTEGRATOR)).step(u)[0].values
    np.testing.assert_allclose(y[1:], [1 / 12 + 1 / 3, 1 / 12 + 1 / 3 + 0.5], atol=1e-12)


def test_a_fine_grid_tends_to_the_differential_equation():
    """The delayed loop's error is first order in dt: halving dt halves it."""
    loop = Feedback(forward=INTEGRATOR, back=Polynomial(coefficients=(0.0, 1.0, 0.0, 0.5)))
    exact = solve_ivp(lambda t, x: 1 - x - 0.5 * x**3, (0, 2), [0.0], rtol=1e-10, atol=1e-12).y[0, -1]
    errors = [abs(loop(np.ones(n + 1), 2 / n)[-1] - exact) for n in (100, 200)]
    assert errors[0] < 0.01
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.1)


def test_a_loop_without_a_solution_says_so():
    relay = Feedback(forward=Coulomb(force=1.0), solve="algebraic")
    with pytest.raises(WhidError, match="jumps over zero") as fault:
        relay(np.array([2.0, 0.5]), 1.0)
    assert fault.value.code == "feedback-no-solution"
    never = Feedback(forward=Polynomial(coefficients=(1.0, 0.0, 1.0)), sign=1, solve="algebraic")
    with pytest.raises(WhidError, match="no value of e") as fault:
        never(np.array([1.0]), 1.0)
    assert "u = 1" in fault.value.where


def test_steady_state_is_the_root_of_the_loop():
    lag = Linear(num=(2.0,), den=(1.0, 1.0))
    y, _ = Feedback(forward=lag, back=Polynomial(coefficients=(0.0, 0.0, 0.0, 1.0))).steady(1.0, 0.1)
    assert y == pytest.approx(2 * (1 - y**3), abs=1e-12)


def test_what_comes_back_belongs_to_a_free_start():
    """A loop released from a level: the start is found from the output, the delayed sample included."""
    from whid.predict import predict
    from whid.record import Record

    loop, u = Feedback(forward=Linear(num=(1.0,), den=(1.0, 1.0))), np.zeros(30)
    y = loop.step(held(u, 0.2, "zoh"), loop.steady(3.0, 0.2)[1])[0].values
    np.testing.assert_allclose(predict(loop, Record(u=u, y=y, dt=0.2, initial="free")), y, atol=1e-9)


def test_derivatives_go_round_in_windows_of_any_length(monkeypatch):
    """A stack of derivatives is taken window by window; where the windows end makes no difference."""
    lag = Linear(num=(1.0,), den=(1.0, 1.0))
    loop = Feedback(forward=lag, back=Polynomial(coefficients=(0.1, 0.4, 0.0, 0.1)), solve="continuous")
    u, names = held(np.sin(np.arange(40.0)), 0.2, "zoh"), [p.name for p in loop.parameters()]

    def derivatives():
        return np.array([t.values for t in loop.tangent(u, [u], names).tangents])

    whole = derivatives()
    monkeypatch.setattr("whid.blocks._relaxed.CELLS", 7 * len(whole) * u.order)
    np.testing.assert_allclose(derivatives(), whole, rtol=0, atol=1e-10)
