"""Crossings of breakpoints: found once each, wherever they are; and what jumps do to a linear block, in closed form."""

import numpy as np
import pytest

from whid.blocks._split import split, total
from whid.blocks.chain import Chain
from whid.blocks.coulomb import Coulomb
from whid.blocks.dead_zone import DeadZone
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.blocks.preload import Preload
from whid.signal import Panels, Signal, held, joined, rule

INTEGRATOR = Linear(num=(1.0,), den=(1.0, 0.0))
JUMP = Piecewise(breaks=(0.0,), pieces=((0.0,), (1.0,)))


def course(function, samples=10, order=8, dt=1.0):
    """A signal that is a polynomial of τ = t/dt on each interval."""
    t = np.arange(samples) + rule(order).nodes[:, None]
    return Signal(function(np.arange(samples) * dt), dt, 0.0, lambda: Panels(function(t * dt)), order)


def crossing_times(signal, *breaks):
    _, c = split(signal, np.array(breaks, float))
    return np.sort(c.interval + c.at)


def test_every_crossing_is_found_once():
    np.testing.assert_allclose(crossing_times(course(lambda t: t - 3.7), 0.0), [3.7], atol=1e-13)
    np.testing.assert_allclose(crossing_times(course(lambda t: t), 2.5, 4.25, 4.75), [2.5, 4.25, 4.75], atol=1e-13)
    np.testing.assert_allclose(crossing_times(course(lambda t: (t - 4.5) ** 2), 0.01), [4.4, 4.6], atol=1e-13)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_crossing_at_a_sample_is_found_once(sign):
    np.testing.assert_allclose(crossing_times(course(lambda t: sign * (t - 4.0)), 0.0), [4.0], atol=1e-12)


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_graze_is_found_however_short(sign, depth):
    turn = 4.512345
    times = crossing_times(course(lambda t: sign * (depth - (t - turn) ** 2)), 0.0)
    np.testing.assert_allclose(times, [turn - np.sqrt(depth), turn + np.sqrt(depth)], atol=1e-10)
    assert len(crossing_times(course(lambda t: sign * (-depth - (t - turn) ** 2)), 0.0)) == 0


def test_many_breakpoints_in_one_interval():
    breaks = np.linspace(3.001, 3.999, 40)
    np.testing.assert_allclose(crossing_times(course(lambda t: t), *breaks), breaks, atol=1e-13)


def test_a_level_on_a_breakpoint_is_no_crossing():
    assert len(crossing_times(course(lambda t: 1 + 1e-17 * np.sin(9 * t)), 1.0)) == 0
    out = Chain(chain=(DeadZone(low=-1.0, high=1.0), Preload(offset=1.0), INTEGRATOR))
    tangent = out.tangent(course(lambda t: 0.1 * t), [course(np.ones_like)], ["chain.1.offset"])
    assert all(np.all(t.values == 0) for t in tangent.tangents)


def test_a_jump_is_integrated_to_the_moment():
    y = Chain(chain=(JUMP, INTEGRATOR)).step(course(lambda t: t - 3.7))[0].values
    np.testing.assert_allclose(y, np.maximum(np.arange(10) - 3.7, 0), atol=1e-13)


def test_on_and_off_within_one_interval():
    y = Chain(chain=(JUMP, INTEGRATOR)).step(course(lambda t: 0.01 - (t - 4.5) ** 2))[0].values
    np.testing.assert_allclose(y, np.where(np.arange(10) > 4, 0.2, 0.0), atol=1e-13)


@pytest.mark.parametrize("width", [1e-6, 1e-10, 1e-13])
def test_very_short_stretches_do_no_harm(width):
    window = Piecewise(breaks=(3.3, 3.3 + width), pieces=((0.0,), (1.0,), (0.0, 2.0)))
    y = Chain(chain=(window, INTEGRATOR)).step(course(lambda t: t))[0].values
    expected = np.where(np.arange(10) > 3, width + np.arange(10) ** 2 - (3.3 + width) ** 2, 0.0)
    np.testing.assert_allclose(y, expected, atol=1e-12)


def test_the_derivative_of_a_jump_is_an_impulse():
    """w = 1(t − c): dy/dc = −1 once the jump is over, wherever in the interval; integrated twice −(t − c)."""
    for at in (3.7, 4.0, 3.0 + 1e-9):
        signal, seed = course(lambda t, at=at: t - at), course(lambda t: -np.ones_like(t))
        once = Chain(chain=(JUMP, INTEGRATOR)).tangent(signal, [seed], ["chain.0.breaks.0"]).tangents
        later = np.arange(10) > at + 1e-6
        np.testing.assert_allclose(once[0].values[later], -1.0, atol=1e-12)
        np.testing.assert_allclose(once[1].values[later], -1.0, atol=1e-12)
        twice = Chain(chain=(JUMP, INTEGRATOR, INTEGRATOR)).tangent(signal, [seed], []).tangents[0]
        np.testing.assert_allclose(twice.values[later], at - np.arange(10)[later], atol=1e-12)


def test_an_impulse_goes_through_feedthrough_and_through_a_curve():
    """w = c²·1(t − a) after a gain and a square: d/da of its integral is −c²."""
    signal, seed = course(lambda t: t - 3.7), course(lambda t: -np.ones_like(t))
    gain, square = Linear(num=(3.0,), den=(1.0,)), Piecewise(breaks=(), pieces=((0.0, 0.0, 1.0),))
    out = Chain(chain=(JUMP, gain, square, INTEGRATOR)).tangent(signal, [seed], ["chain.1.num.0"])
    np.testing.assert_allclose(out.tangents[0].values[4:], -9.0, atol=1e-12)
    np.testing.assert_allclose(out.tangents[1].values[4:], 6.0 * (np.arange(4, 10) - 3.7), atol=1e-12)


def test_sums_keep_the_switching_points_of_both():
    one, two = (
        Chain(chain=(Piecewise(breaks=(b,), pieces=((0.0,), (1.0,))),)).step(course(lambda t: t))[0] for b in (3.3, 3.6)
    )
    y = INTEGRATOR.step(total([one, two, course(np.ones_like)]))[0].values
    t = np.arange(10)
    np.testing.assert_allclose(y, t + np.maximum(t - 3.3, 0) + np.maximum(t - 3.6, 0), atol=1e-12)


def test_joined_signals_are_the_whole():
    whole = Chain(chain=(Coulomb(force=1.0), Linear(num=(1.0, 1.0), den=(1.0, 2.0)))).step(course(lambda t: np.sin(t)))[0]
    again = joined(whole[:3], whole[3:4], whole[4:])
    np.testing.assert_array_equal(again.values, whole.values)
    np.testing.assert_allclose(INTEGRATOR.step(again)[0].values, INTEGRATOR.step(whole)[0].values, atol=1e-14)


def test_a_held_input_is_constant_between_samples():
    y = Chain(chain=(JUMP, INTEGRATOR)).step(held(np.array([-1.0, 1.0, 1.0, -1.0, 1.0]), 1.0, "zoh"))[0].values
    np.testing.assert_allclose(y, [0, 0, 1, 2, 2], atol=1e-15)
