"""Static blocks against their equations written another way; impossible ones refused."""

import numpy as np
import pytest

from tests.blocks.examples import EXAMPLES
from whid.blocks._static import Static
from whid.blocks.coulomb import Coulomb
from whid.blocks.dead_zone import DeadZone
from whid.blocks.kinked import Kinked
from whid.blocks.piecewise import Piecewise
from whid.blocks.polynomial import Polynomial
from whid.blocks.preload import Preload
from whid.blocks.quantizer import Quantizer
from whid.blocks.relay import Relay
from whid.blocks.saturation import Saturation
from whid.blocks.table import Table
from whid.blocks.viscous import Viscous
from whid.errors import WhidError

V = np.linspace(-3, 3, 241) + 0.0001  # no sample on a breakpoint
STATIC = [b for blocks in EXAMPLES.values() for b in blocks if isinstance(b, Static)]


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (DeadZone(low=-1.0, high=0.5, slope=2.0), np.where(V > 0.5, 2 * (V - 0.5), np.where(V < -1, 2 * (V + 1), 0))),
        (Saturation(low=-1.0, high=0.5, slope=2.0), np.where(V > 0.5, 1.0, np.where(V < -1, -2.0, 2 * V))),
        (Polynomial(coefficients=(1.0, -2.0, 0.0, 0.5)), 1 - 2 * V + 0.5 * V * V * V),
        (Polynomial(coefficients=(1.0, -2.0, 0.5), basis="chebyshev"), 1 - 2 * V + 0.5 * (2 * V * V - 1)),
        (
            Polynomial(coefficients=(0.0, 0.0, 0.0, 1.0), basis="chebyshev", domain=(-3, 4)),
            np.cos(3 * np.arccos((2 * V - 1) / 7)),
        ),
        (Preload(offset=0.5, slope=2.0), np.where(V > 0, 2 * V + 0.5, 2 * V - 0.5)),
        (Coulomb(force=2.0, offset=1.0), np.where(V > 0, 3.0, -1.0)),
        (Viscous(coefficient=2.0, negative=3.0), np.where(V > 0, 2 * V, 3 * V)),
        (Piecewise(breaks=(0.0,), pieces=((1.0, 1.0), (0.0, 0.0, 2.0))), np.where(V < 0, 1 + V, 2 * V**2)),
        (Table(inputs=(-2.0, 0.0, 1.0), outputs=(0.0, 1.0, 4.0), beyond="hold"), np.interp(V, [-2, 0, 1], [0, 1, 4])),
        (Table(inputs=(-2.0, 0.0, 1.0), outputs=(0.0, 1.0, 4.0)), np.where(V > 0, 1 + 3 * V, 1 + V / 2)),
        (
            Kinked(coefficients=(1.0, 0.5), breaks=(-1.0, 0.0), kinks=((1.0,), (0.0, 2.0))),
            1 + V / 2 + np.where(V > -1, V + 1, 0) + np.where(V > 0, 2 * V**2, 0),
        ),
        (Quantizer(step_=0.25), np.round(V / 0.25) * 0.25),
        (Quantizer(step_=0.25, mode="floor"), (V - V % 0.25)),
    ],
)
def test_values(block, expected):
    np.testing.assert_allclose(block(V, 1.0), expected, atol=1e-12)


@pytest.mark.parametrize("block", STATIC, ids=lambda b: b.kind)
def test_breakpoints_and_jumps_are_those_of_the_curve(block):
    breaks, jumps = block.breakpoints(), block.jumps()
    assert np.all(np.diff(breaks) > 0)
    assert len(breaks) == len(jumps)
    h = 1e-9
    np.testing.assert_allclose(block.value(breaks + h) - block.value(breaks - h), jumps, atol=1e-7)
    if len(breaks):  # everywhere else the curve is continuous
        fine = np.setdiff1d(np.linspace(-2, 2, 4001), np.round(breaks, 12))
        apart = np.abs(fine[:, None] - breaks).min(axis=1) > 2e-3
        assert np.abs(block.value(fine + 5e-4) - block.value(fine - 5e-4))[apart].max() < 0.05


@pytest.mark.parametrize("block", STATIC, ids=lambda b: b.kind)
def test_break_rates_are_finite_differences(block):
    for p in block.parameters(held=True):
        moved = block.with_parameters({p.name: p.value + 1e-6}).breakpoints() - block.breakpoints()
        np.testing.assert_allclose(block.break_rates(p.name), moved / 1e-6, atol=1e-6)


def test_a_quantizer_of_many_levels_keeps_to_its_course():
    """A ramp through 2000 levels, integrated: the mean of the staircase is the ramp."""
    from whid.blocks.chain import Chain
    from whid.blocks.linear import Linear
    from whid.signal import held

    tree = Chain(chain=(Quantizer(step_=0.001), Linear(num=(1.0,), den=(1.0, 0.0))))
    y = tree.step(held(np.linspace(-1, 1, 101), 1.0, "foh"))[0].values
    t = np.arange(101.0)
    np.testing.assert_allclose(y, -t + t**2 / 100, atol=1e-9)


def test_a_relay_switches_at_the_moment_it_is_crossed():
    """v = ±1 triangle, thresholds ±0.5: the integral of w, by hand."""
    from whid.blocks.chain import Chain
    from whid.blocks.linear import Linear
    from whid.signal import held

    tree = Chain(chain=(Relay(low=-0.5, high=0.5), Linear(num=(1.0,), den=(1.0, 0.0))))
    v = held(np.array([0.0, 1.0, 0.0, -1.0, 0.0, 1.0]), 1.0, "foh")
    y = tree.step(v)[0].values  # off until t = 0.5, on until 2.5, off until 4.5
    np.testing.assert_allclose(y, [0, 0, 1, 1, 0, 0], atol=1e-14)


@pytest.mark.parametrize(
    "make",
    [
        lambda: DeadZone(low=1.0, high=0.0),
        lambda: Saturation(low=1.0, high=0.0),
        lambda: Relay(low=1.0, high=0.0),
        lambda: Table(inputs=(0.0, 0.0), outputs=(1.0, 2.0)),
        lambda: Table(inputs=(0.0, 1.0), outputs=(1.0,)),
        lambda: Piecewise(breaks=(1.0, 0.0), pieces=((0.0,), (0.0,), (0.0,))),
        lambda: Piecewise(breaks=(1.0,), pieces=((0.0,),)),
        lambda: Kinked(coefficients=(0.0,), breaks=(1.0, 0.0), kinks=((1.0,), (1.0,))),
        lambda: Kinked(coefficients=(0.0,), breaks=(1.0,), kinks=((1.0,), (1.0,))),
        lambda: Polynomial(coefficients=(1.0,), basis="chebyshev", domain=(1.0, 1.0)),
        lambda: Polynomial(coefficients=(1.0,), domain=(0.0, 1.0)),
    ],
)
def test_impossible_blocks_are_refused(make):
    with pytest.raises(WhidError) as fault:
        make()
    assert fault.value.code == "block-parameters"


def test_one_polynomial_in_another_basis():
    power = Polynomial(coefficients=(0.3, -1.0, 0.0, 0.7))
    for other in (Polynomial(coefficients=(1.0,) * 6, basis="chebyshev", domain=(-3.0, 4.0)), power):
        there = power.like(other)
        assert (there.basis, there.domain, len(there.coefficients)) == (other.basis, other.domain, len(other.coefficients))
        np.testing.assert_allclose(there(V, 1.0), power(V, 1.0), atol=1e-12)
        np.testing.assert_allclose(there.like(power).coefficients[:4], power.coefficients, atol=1e-12)


@pytest.mark.parametrize("block", STATIC, ids=lambda block: block.kind)
def test_panels_on_one_piece_need_looking_up_once(block):
    """Between two borders, and beyond the first and the last, both ways give the same to the last bit."""
    borders = np.concatenate([[-4.0], np.sort(block.breakpoints()), [4.0]])
    low, high = borders[:-1], borders[1:]
    v = (low + (high - low) * np.array([[1e-9], [0.3], [0.7], [1 - 1e-9]]))[:, high > low]
    np.testing.assert_array_equal(block.on_pieces(v), block.value(v))
    np.testing.assert_array_equal(block.derivative_on_pieces(v), block.derivative(v))
