"""Chains of several nonlinearities and dynamics against an ODE solver that knows none of our code paths."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from whid.blocks.chain import Chain
from whid.blocks.dead_zone import DeadZone
from whid.blocks.linear import Linear
from whid.blocks.parallel import Parallel
from whid.blocks.piecewise import Piecewise
from whid.blocks.preload import Preload
from whid.blocks.viscous import Viscous
from whid.errors import WhidError
from whid.signal import held

DT = 0.25
U = 2 * np.sin(0.7 * np.arange(41) ** 1.1)


def test_hammerstein_wiener_on_straight_lines():
    """Dead zone, lag, preload (a jump), lag: every switch between samples; the solver restarts at each sample."""
    tree = Chain(
        chain=(
            DeadZone(low=-0.3, high=0.4), Linear(num=(1.0,), den=(1.0, 1.0)),
            Preload(offset=0.2), Linear(num=(2.0,), den=(1.0, 2.0)),
        )
    )  # fmt: skip
    y = tree.step(held(U, DT, "foh", order=8))[0].values

    def right(t, x):
        u = np.interp(t, DT * np.arange(41), U)
        w = u - np.clip(u, -0.3, 0.4)
        return [w - x[0], 2 * (x[0] + 0.2 * np.sign(x[0])) - 2 * x[1]]

    x, expected = np.zeros(2), [0.0]
    for n in range(40):
        x = solve_ivp(right, (n * DT, (n + 1) * DT), x, "LSODA", rtol=1e-9, atol=1e-11, max_step=DT / 200).y[:, -1]
        expected.append(x[1])
    error = np.abs(y - expected).max()
    print(f"f-G-f-G on straight lines against LSODA: {error:.1e}")
    assert error < 2e-6


def test_twice_the_nodes_change_nothing():
    """A finer rule inside the intervals gives the same samples: the panels resolve the course.

    The jump is not at the rest value: a course that leaves a jump with zero slope is only as exact as rounding ^ (1/3).
    """
    tree = Chain(
        chain=(
            DeadZone(low=-0.3, high=0.4), Linear(num=(4.0,), den=(1.0, 0.8, 4.0)),
            Parallel(parallel=(Piecewise(breaks=(0.11,), pieces=((0.0,), (0.4,))), Viscous(coefficient=1.0, negative=0.5))),
            Linear(num=(2.0,), den=(1.0, 2.0)),
        )
    )  # fmt: skip
    coarse, fine = (tree.step(held(U, DT, "foh", order=q))[0].values for q in (8, 16))
    np.testing.assert_allclose(coarse, fine, atol=1e-9)


def test_only_what_is_downstream_of_a_number_feels_it():
    tree = Chain(chain=(Linear(num=(1.0,), den=(1.0, 1.0)), Preload(offset=0.2), Linear(num=(2.0,), den=(1.0, 2.0))))
    names = ["chain.2.den.1", "chain.0.num.0", "chain.1.offset"]  # in any order
    signal = held(U, DT, "zoh")
    together = tree.tangent(signal, [], names).tangents
    for name, tangent in zip(names, together, strict=True):
        alone = tree.tangent(signal, [], [name]).tangents[0].values  # a matrix product of another size rounds differently
        np.testing.assert_allclose(tangent.values, alone, rtol=0, atol=1e-15)


def test_an_integrator_in_a_chain_has_no_steady_state():
    tree = Chain(chain=(DeadZone(low=-1.0, high=1.0), Linear(num=(1.0,), den=(1.0, 0.0))))
    assert tree.steady(0.5, DT)[0] == 0.0
    with pytest.raises(WhidError) as fault:
        tree.steady(2.0, DT)
    assert fault.value.code == "block-no-steady-state"
