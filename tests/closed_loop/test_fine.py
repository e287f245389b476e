"""The oversampled simulator against closed forms."""

import numpy as np
import pytest

from tests.closed_loop.fine import Backlash, Beside, Filter, Loop, Series, SlewLimit, Static, fine, played

DT = 0.1
U = np.repeat([0.0, 1.0, -0.5, 2.0], 20)


def samples(signal):
    return signal.start[:: signal.factor]


def test_a_lag_answers_a_step_exactly():
    y = samples(Filter((2.0,), (0.7, 1.0))(fine(U[:40], DT)))
    t = DT * np.arange(20)
    assert y[:21] == pytest.approx(0.0, abs=1e-15)
    assert y[20:40] == pytest.approx(2 * (1 - np.exp(-t / 0.7)), abs=1e-12)


def test_a_ramp_and_its_lag_are_exact():
    u = 0.3 * np.arange(60.0) * DT
    y = samples(Filter((1.0,), (0.5, 1.0))(fine(u, DT, "foh")))[:-1]
    t = DT * np.arange(59)
    assert y == pytest.approx(0.3 * (t - 0.5 * (1 - np.exp(-t / 0.5))), abs=1e-12)


def test_two_filters_in_a_row_are_their_product_up_to_the_fine_step_squared():
    one, two, product = Filter((1.0,), (0.3, 1.0)), Filter((2.0,), (0.05, 0.2, 1.0)), Filter((2.0,), (0.015, 0.11, 0.5, 1.0))

    def error(factor):
        u = fine(U, DT, factor=factor)
        return np.abs(samples(two(one(u))) - samples(product(u))).max()

    bend = 2.5 / 0.3**2  # |v''| at most, after the largest step; a straight line misses v''h²/12 on the mean
    assert error(24) < 2 * bend * (DT / 24) ** 2 / 12
    assert error(12) / error(24) == pytest.approx(4.0, rel=0.05)


def test_a_static_curve_between_filters_converges():
    tree = Series((Filter((1.0,), (0.3, 1.0)), Static(lambda v: np.maximum(v, 0.4)), Filter((1.0,), (0.4, 1.0))))
    exact = samples(tree(fine(U, DT, factor=768)))
    assert np.abs(samples(tree(fine(U, DT))) - exact).max() < 2e-5


def test_a_jump_between_filters_is_met_where_it_is():
    """v = 1 − e^(−t/.3) crosses ½ at t = .3·ln 2; from there the lag of .4 behind the jump rises."""
    tree = Series(
        (Filter((1.0,), (0.3, 1.0)), Static(lambda v: 3.0 * (v >= 0.5), ((0.5, 3.0),)), Filter((1.0,), (0.4, 1.0)))
    )
    y = samples(tree(fine(U[:40], DT)))[20:]
    since = np.maximum(DT * np.arange(20) - 0.3 * np.log(2), 0.0)
    assert y == pytest.approx(3 * (1 - np.exp(-since / 0.4)), abs=3e-5)


def test_a_loop_is_its_closed_form():
    """k/(τs + 1 + kg) from k/(τs + 1) with g behind it."""
    closed = samples(Filter((2.0 / 1.5,), (0.6 / 1.5, 1.0))(fine(U, DT)))
    looped = samples(Loop(Filter((2.0,), (0.6, 1.0)), Static(lambda y: 0.25 * y))(fine(U, DT)))
    assert looped == pytest.approx(closed, abs=3e-5)


def test_a_loop_that_runs_away_says_so():
    with pytest.raises(ArithmeticError):
        Loop(Filter((2.0,), (0.01, 1.0)), Static(lambda y: 3.0 * y))(fine(U, DT))


def test_a_branch_beside():
    u = fine(U, DT)
    both = Beside(Static(lambda v: 2 * v), Static(np.sign))(u)
    assert both.held
    assert (both.start == 2 * u.start + np.sign(u.start)).all()


def test_a_play_rests_until_the_gap_is_crossed():
    x = np.array([0.0, 0.4, 1.0, 0.6, 0.0, -1.0, -0.2, 0.5])
    assert played(x, 1.0) == pytest.approx([0.0, 0.0, 0.5, 0.5, 0.5, -0.5, -0.5, 0.0])
    held, course = Backlash(1.0)(fine(U, DT)), Backlash(1.0)(fine(U, DT, "foh"))
    assert samples(held) == pytest.approx(played(U, 1.0))
    assert samples(course)[1:] == pytest.approx(played(U, 1.0)[1:])


def test_a_slew_limit_moves_at_its_rate_and_arrives():
    y = samples(SlewLimit(0.5)(fine(U, DT)))
    assert y[20:40] == pytest.approx(np.minimum(0.05 * np.arange(20), 1.0))
    fast = SlewLimit(1e6)(fine(U, DT))
    assert samples(fast)[21:40] == pytest.approx(U[21:40])
