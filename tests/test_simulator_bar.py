"""Bar A1: the exact path against analytic harmonics, an independent quadrature, and an ODE solver."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from whid.blocks.chain import Chain
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.signal import held

FRONT = Linear(num=(0.04,), den=(1.0, 0.5, 0.04))
BACK = Linear(num=(0.1,), den=(1.0, 0.7, 0.1))
CURVE = Piecewise(
    breaks=(-2.4, -0.8, 0.8, 3.2), pieces=((-200.0,), (-50.0, 62.5), (0.0,), (-25.0, 0.0, 31.25), (160.0, 12.5))
)
PLANT = Chain(chain=(FRONT, CURVE, BACK))
DT = np.pi / 6


def simulated(u, course, plant=PLANT, dt=DT):
    _, state = plant.steady(float(u[0]), dt)
    return plant.step(held(u, dt, course, order=plant.panel_order(dt)), state)[0].values


def harmonics(y):
    return np.fft.rfft(y)[:4] / len(y) * np.array([1, 2, 2, 2])


@pytest.mark.parametrize("period", [600, 300, 200])
def test_continuous_sine_has_the_analytic_harmonics(period):
    """v = α + Re g e^{jωt} stays on the quadratic piece, so y has harmonics 0, 1 and 2, each through the back block.

    A cosine that ends at a peak is its own mirror image: the trigonometric interpolation is the cosine itself.
    """
    u = 2 + np.cos(2 * np.pi * np.arange(40 * period + period // 2 + 1) / period)
    y = simulated(u, "bandlimited")[-period // 2 - period : -period // 2]
    omega = 2 * np.pi / (period * DT)
    (front,) = FRONT.gain_at(np.array([omega]))
    g, a = front, 2.0
    w = np.array([31.25 * (a**2 + abs(g) ** 2 / 2) - 25, 62.5 * a * g, 31.25 * g**2 / 2, 0])
    phase = np.exp(1j * np.arange(4) * 2 * np.pi * (len(u) - 1 - period // 2 - period + 1) / period)
    expected = w * BACK.gain_at(omega * np.arange(4)) * phase
    error = np.abs(harmonics(y) - expected).max()
    print(f"A1 harmonics, {period} samples a period: {error:.1e}")
    assert error < 1e-9


def periodic_reference(u, dt, nodes=40):
    """One period of the steady state for a held periodic input: matrix exponentials and Gauss quadrature, no filters."""
    x, weights = np.polynomial.legendre.leggauss(nodes)
    tau, weights = (x + 1) / 2 * dt, weights / 2 * dt

    def system(block):
        num, den = block.num, block.den
        a = np.array([[-den[1], -den[2]], [1.0, 0.0]])
        return a, np.array([1.0, 0.0]), np.array([0.0, num[0]])

    def flow(a, b, t):
        block = np.zeros((3, 3))
        block[:2, :2], block[:2, 2] = a, b
        e = expm(block * t)
        return e[:2, :2], e[:2, 2]

    def periodic(phi, drive):
        free = np.zeros(2)
        for d in drive:
            free = phi @ free + d
        state = np.linalg.solve(np.eye(2) - np.linalg.matrix_power(phi, len(drive)), free)
        states = []
        for d in drive:
            states.append(state)
            state = phi @ state + d
        return np.array(states)

    a, b, c = system(FRONT)
    phi, gamma = flow(a, b, dt)
    x = periodic(phi, gamma * u[:, None])
    v = np.array([x @ (c @ flow(a, b, t)[0]) + (c @ flow(a, b, t)[1]) * u for t in tau])
    w = CURVE.value(v)
    a, b, c = system(BACK)
    push = np.array([flow(a, b, dt - t)[0] @ b * h for t, h in zip(tau, weights, strict=True)])
    return periodic(flow(a, b, dt)[0], w.T @ push) @ c


def test_held_sine_against_independent_quadrature():
    period = 200
    one = 2 + np.cos(2 * np.pi * np.arange(period) / period)
    y = simulated(np.tile(one, 40), "zoh")[-period:]
    error = np.abs(y - periodic_reference(one, DT)).max()
    print(f"A1 held sine against quadrature: {error:.1e}")
    assert error < 1e-9


def test_breakpoints_against_an_ode_solver_and_a_finer_grid():
    """u = 0.5 + 4 cos ωt sweeps v across all four breakpoints, jumps included."""
    period, samples = 100, 201
    u = 0.5 + 4 * np.cos(2 * np.pi * np.arange(samples) / period)
    y = simulated(u, "bandlimited")
    fine = simulated(0.5 + 4 * np.cos(2 * np.pi * np.arange(8 * (samples - 1) + 1) / (8 * period)), "bandlimited", dt=DT / 8)
    omega = 2 * np.pi / (period * DT)

    def right(t, x):
        w = CURVE.value(np.array([0.04 * x[1]]))[0]
        u = 0.5 + 4 * np.cos(omega * t)
        return [-0.5 * x[0] - 0.04 * x[1] + u, x[0], -0.7 * x[2] - 0.1 * x[3] + w, x[2]]

    start = [0.0, 4.5 / 0.04, 0.0, CURVE.value(np.array([4.5]))[0] / 0.1]
    ode = solve_ivp(
        right, (0, (samples - 1) * DT), start, "LSODA", DT * np.arange(samples), rtol=1e-10, atol=1e-10, max_step=0.01
    )
    against_ode, against_fine = np.abs(y - 0.1 * ode.y[3]).max(), np.abs(y - fine[::8]).max()
    print(f"A1 across the breakpoints: {against_ode:.1e} against LSODA, {against_fine:.1e} against an 8 times finer grid")
    assert against_ode < 5e-5
    assert against_fine < 1e-9
