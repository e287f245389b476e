"""Delays against shifted closed forms."""

import numpy as np
import pytest

from whid.blocks.chain import Chain
from whid.blocks.delay import Delay
from whid.blocks.linear import Linear
from whid.signal import held

INTEGRATOR = Linear(num=(1.0,), den=(1.0, 0.0))


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.25, 1.0, 2.5, 3.0, 100.0])
def test_a_held_input_is_shifted_in_time(seconds):
    """The integral of a delayed unit step is a delayed ramp, any fraction of a sample."""
    y = Chain(chain=(Delay(seconds=seconds), INTEGRATOR))(np.ones(40), 0.5)
    np.testing.assert_allclose(y, np.maximum(0.5 * np.arange(40) - seconds, 0), atol=1e-12)


@pytest.mark.parametrize("course", ["zoh", "foh"])
@pytest.mark.parametrize("seconds", [0.3, 0.5, 1.7])
def test_a_delay_commutes_with_a_linear_block(seconds, course):
    u = held(np.random.default_rng(3).standard_normal(50), 0.5, course, order=8)
    lag = Linear(num=(1.0, 0.5), den=(1.0, 2.0, 5.0))
    before, after = (
        Chain(chain=c).step(u)[0].values for c in ((Delay(seconds=seconds), lag), (lag, Delay(seconds=seconds)))
    )
    np.testing.assert_allclose(before, after, atol=1e-7)  # the lag's output is a polynomial of degree 7 an interval


def test_twice_half_a_delay_is_the_delay():
    u = held(np.random.default_rng(3).standard_normal(50), 0.5, "foh", order=8)
    whole, halves = (
        Chain(chain=(*delays, INTEGRATOR)).step(u)[0].values
        for delays in ((Delay(seconds=1.3),), (Delay(seconds=0.65),) * 2)
    )
    np.testing.assert_allclose(halves, whole, atol=1e-12)


def test_the_sampled_path_interpolates():
    np.testing.assert_allclose(Delay(seconds=1.25)(np.arange(6.0), 1.0, "discrete"), [0, 0, 0.75, 1.75, 2.75, 3.75])


def test_a_steady_start_before_a_course_of_another_order():
    """What stood before is held on as many nodes as the course behind it has."""
    u = held(np.array([1.0, 1.0, 2.0, 2.0]), 0.1, "foh", order=6)
    delay = Delay(seconds=0.05)
    _, state = delay.steady(1.0, 0.1)
    y, _ = delay.step(u, state)
    np.testing.assert_allclose(y.values, [1.0, 1.0, 1.5, 2.0], atol=1e-12)
