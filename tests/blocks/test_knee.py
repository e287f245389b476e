"""Rounded corners and jumps: against the moving average they are, and against their hard limit."""

import dataclasses

import numpy as np
import pytest

from whid.blocks.dead_zone import DeadZone
from whid.blocks.piecewise import Piecewise
from whid.blocks.saturation import Saturation
from whid.blocks.table import Table
from whid.errors import WhidError

V = np.linspace(-2.0, 2.0, 401) + 1e-4
STRAIGHT = [
    Saturation(low=-0.5, high=0.8, slope=1.3),
    DeadZone(low=-0.3, high=0.55, slope=1.7),
    Table(inputs=(-1.0, -0.2, 0.4, 1.1), outputs=(-2.0, 0.0, 0.1, 0.9)),
    Table(inputs=(-1.0, -0.2, 0.4, 1.1), outputs=(-2.0, 0.0, 0.1, 0.9), beyond="hold"),
    Piecewise(breaks=(-0.6, 0.3), pieces=((-1.0,), (0.5, 1.0), (2.0, -0.5))),  # two jumps
]
CURVED = Piecewise(breaks=(-0.6, 0.2), pieces=((-0.1,), (0.5, 1.0), (0.68, 0.0, 0.5, 0.1)))


def soft(block, knee):
    return dataclasses.replace(block, knee=knee)


@pytest.mark.parametrize("knee", [0.2, 0.5, 1.4])
@pytest.mark.parametrize("block", STRAIGHT, ids=lambda b: b.kind)
def test_a_knee_is_a_moving_average_of_straight_lines(block, knee):
    """Overlapping knees too; the average by quadrature between the breakpoints of the hard curve."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    for v in V[::20]:
        ends = np.concatenate([[v - knee / 2], block.breakpoints(), [v + knee / 2]])
        ends = np.sort(ends[(ends >= v - knee / 2) & (ends <= v + knee / 2)])
        middle, half = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
        average = float(np.sum(block.value(middle[:, None] + half[:, None] * nodes) * weights * half[:, None])) / knee
        assert soft(block, knee).value(np.array([v]))[0] == pytest.approx(average, abs=1e-12)


@pytest.mark.parametrize("block", [*STRAIGHT, CURVED], ids=lambda b: b.kind)
def test_no_knee_is_the_hard_limit_with_its_tangents(block):
    names = [p.name for p in block.parameters()]
    for knee in (0.0, 1e-9):
        limit = soft(block, knee)
        assert [p.name for p in limit.parameters()] == [*names, "knee"]
        np.testing.assert_allclose(limit.value(V), block.value(V), atol=1e-12)
        np.testing.assert_allclose(limit.derivative(V), block.derivative(V), atol=1e-12)
        for name in names:
            np.testing.assert_allclose(limit.sensitivity(V, name), block.sensitivity(V, name), atol=1e-12)
        assert not limit.sensitivity(V, "knee").any()
    np.testing.assert_array_equal(soft(block, 0.0).breakpoints(), block.breakpoints())
    np.testing.assert_array_equal(soft(block, 0.0).jumps(), block.jumps())


@pytest.mark.parametrize("block", [*STRAIGHT, CURVED], ids=lambda b: b.kind)
def test_beyond_half_a_knee_nothing_changes(block):
    far = np.abs(V[:, None] - block.breakpoints()).min(axis=1) > 0.151
    np.testing.assert_allclose(soft(block, 0.3).value(V)[far], block.value(V)[far], atol=1e-13)
    assert np.abs(soft(block, 0.3).value(V) - block.value(V)).max() > 1e-3


def test_a_rounded_jump_is_a_steep_line_and_a_kink_stays_a_kink_of_the_hard_curve():
    block = soft(STRAIGHT[-1], 0.2)
    assert not block.jumps().any()
    assert block.kinks().tolist() == STRAIGHT[-1].kinks().tolist() == [False, False]
    np.testing.assert_allclose(block.value(np.array([-0.7, -0.6, -0.5])), [-1.0, -0.525, 0.0], atol=1e-12)


@pytest.mark.parametrize("block", [*STRAIGHT, CURVED], ids=lambda b: b.kind)
def test_a_negative_knee_is_refused(block):
    with pytest.raises(WhidError, match="knee"):
        soft(block, -0.1)
