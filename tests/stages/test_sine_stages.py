"""The parts of the sine stages against independent formulas; their statistics are bars A5 and A6's business."""

import numpy as np
import pytest

from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.signal import Signal
from whid.stages._chain_fit import ChainFit, FreeResponse, RationalResponse, frequencies
from whid.stages._inner_harmonics import held_sine, inner_harmonics
from whid.stages._responses import Responses, StaticPart
from whid.stages.identifiability import identifiability, phase_system
from whid.stages.stepwise import stepwise

BREAKS = np.array([-2.4, -0.8, 0.8, 3.2])
PIECES = np.array([[-200.0, 0, 0], [-50, 62.5, 0], [0, 0, 0], [-25, 0, 31.25], [160, 12.5, 0]])


@pytest.mark.parametrize(("offset", "amplitude"), [(2.0, 1.0), (2.0, 1.5), (1.0, 3.7), (0.3, 4.9)])
def test_harmonics_of_a_hard_curve_against_the_midpoint_rule(offset, amplitude):
    f = Piecewise(breaks=tuple(BREAKS), pieces=tuple(map(tuple, PIECES)))
    theta = (np.arange(400_000) + 0.5) / 400_000 * np.pi
    w = f.value(offset + amplitude * np.cos(theta))
    expected = np.array([2 * np.mean(w * np.cos(k * theta)) for k in range(21)])
    expected[0] /= 2
    found = inner_harmonics(BREAKS, PIECES, np.array([offset]), np.array([amplitude]), 20).value[0]
    assert np.allclose(found, expected, atol=100 * np.pi / 400_000 * 4)  # the rule misplaces each jump by up to half a step


def test_harmonics_of_the_paper():
    """[Brouri2019], (4.4b): A₀ … A₃ of a cubic."""
    c0, c1, c2, c3, alpha, g = -24.8, 0.02, 31.24, -0.003, 2.0, 0.85
    printed = [
        c0 + alpha * (c1 + alpha * c2 + alpha**2 * c3) + g**2 / 2 * (c2 + 3 * alpha * c3),
        (c1 + 2 * alpha * c2 + 3 * c3 * (alpha**2 + g**2 / 4)) * g,
        (c2 + 3 * alpha * c3) * g**2 / 2,
        c3 * g**3 / 4,
    ]
    found = inner_harmonics(np.empty(0), np.array([[c0, c1, c2, c3]]), np.array([alpha]), np.array([g]), 3).value[0]
    assert np.allclose(found, printed, rtol=1e-13)


@pytest.mark.parametrize(("offset", "amplitude"), [(2.0, 1.5), (1.0, 3.7)])
def test_derivatives_of_the_harmonics(offset, amplitude):
    at = lambda breaks, pieces, a: inner_harmonics(breaks, pieces, np.array([offset]), np.array([a]), 8).value[0]  # noqa: E731
    found = inner_harmonics(BREAKS, PIECES, np.array([offset]), np.array([amplitude]), 8)
    h = 1e-5
    slope = (at(BREAKS, PIECES, amplitude + h) - at(BREAKS, PIECES, amplitude - h)) / (2 * h)
    assert np.allclose(found.by_amplitude[0], slope, rtol=1e-6, atol=1e-6)
    for j in range(4):
        d = h * np.eye(4)[j]
        slope = (at(BREAKS + d, PIECES, amplitude) - at(BREAKS - d, PIECES, amplitude)) / (2 * h)
        assert np.allclose(found.by_break[0, :, j], slope, rtol=1e-6, atol=1e-5)
    for p in range(5):
        d = np.zeros_like(PIECES)
        d[p, 1] = h
        slope = (at(BREAKS, PIECES + d, amplitude) - at(BREAKS, PIECES - d, amplitude)) / (2 * h)
        assert np.allclose(found.by_coefficient[0, :, p, 1], slope, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_what_a_held_cosine_does_to_a_slow_block(hold):
    """The block filters the images out; what is left is the phasor times G(jω)."""
    g, dt, period = Linear(num=(1.0,), den=(400.0, 40.0, 1.0)), 0.5, 60
    n = np.arange(200 * period)
    u = 1.3 * np.cos(2 * np.pi * n / period + 0.4)
    from whid.signal import held

    y = g.step(held(u, dt, hold))[0].values[-period:]
    omega = 2 * np.pi / (period * dt)
    measured = 2 / period * np.sum(y * np.exp(-2j * np.pi * n[-period:] / period))
    expected = held_sine(1.3, 0.4, omega, dt, hold) * g.gain_at(np.array([omega]))[0]
    assert abs(measured - expected) < 2e-6 * abs(expected)
    late = 1.3 * np.exp(0.4j) * g.gain_at(np.array([omega]))[0]  # half a sample off with zoh: 0.05 rad here
    assert abs(measured - late) > (5e-2 if hold == "zoh" else 8e-4) * abs(expected) * 0.9
    assert isinstance(g.step(Signal(u, dt))[0].values, np.ndarray)


def chain_problem(front, back, breaks=(), free=()):
    rng = np.random.default_rng(4)
    omega = np.array([0.3, 0.6, 0.9])
    orders = ((0, 1, 2), (0, 1, 2, 3), (0, 1, 2))
    value = rng.normal(size=(3, 4)) + 1j * rng.normal(size=(3, 4))
    responses = Responses(omega, np.array([0.4, 0.5, 0.6]), np.array([1.0, 0.9, 1.1j]), value, np.full((3, 4), 0.1), orders)
    pieces = np.array([[0.2, 0.5, 0.7], [0.1, -0.4, 0.3]])[: len(breaks) + 1]
    level = np.array([-0.5, 0.2, 0.9, 1.4])
    static = StaticPart(level, np.zeros(4), np.full(4, 0.1), np.array(breaks), pieces, (2,) * len(pieces))
    fronts, backs = frequencies(responses)
    return ChainFit(responses, static, front(fronts), back(backs), free)


def free(block):
    return lambda omega: FreeResponse(omega, np.exp(-0.2 * omega - 0.7j * omega), block)


def rational(block):
    return lambda omega: RationalResponse(omega, np.array([0.3]), np.array([0.9, 0.5]), 0.5, block)


@pytest.mark.parametrize("breaks", [(), (0.8,)])
@pytest.mark.parametrize("response", [free, rational])
def test_tangent_of_the_chain_fit_is_its_finite_difference(response, breaks):
    problem = chain_problem(response("front"), response("back"), breaks, tuple(range(len(breaks))))
    theta = np.array([p.value for p in problem.parameters()])
    _, tangent = problem.linearised(theta)
    for j, d in enumerate(1e-6 * np.eye(len(theta))):
        slope = (problem.linearised(theta + d)[0] - problem.linearised(theta - d)[0]) / 2e-6
        assert np.allclose(tangent[:, j], slope, rtol=1e-5, atol=1e-6), problem.parameters()[j].name


def test_stepwise_without_noise_is_exact():
    omega, alpha, gain = np.array([0.1, 0.2]), 2.0, np.array([0.9, 0.7])
    c = np.array([-25.0, 0.3, 31.25])
    back = {0.1: 0.95 * np.exp(-0.2j), 0.2: 0.8 * np.exp(-0.5j), 0.4: 0.5 * np.exp(-1.1j)}
    value = np.zeros((2, 3), complex)
    for e, w in enumerate(omega):
        x = gain[e] * np.exp(-0.3j * (e + 1))
        value[e] = [
            c[0] + c[1] * alpha + c[2] * (alpha**2 + gain[e] ** 2 / 2),
            (c[1] + 2 * c[2] * alpha) * x,
            c[2] * x**2 / 2,
        ]
        value[e, 1:] *= [back[w], back[round(2 * w, 6)]]
    level = np.array([1.0, 1.5, 2.0, 2.5, 3.0])
    static = StaticPart(level, np.polyval(c[::-1], level), np.full(5, 0.04), np.empty(0), c[None, :], (2,))
    responses = Responses(omega, np.full(2, alpha), np.ones(2, complex), value, np.full((2, 3), 0.005), ((0, 1, 2),) * 2)
    found = stepwise(static, responses)
    assert np.allclose(found.front_gain, gain, rtol=1e-12)
    assert np.allclose(found.back_gain, [[0.95, 0.8], [0.8, 0.5]], rtol=1e-12)


def test_phase_system_ranks():
    """A quadratic sees octaves only, a cubic thirds as well; a delay is free in every connected group."""
    octaves = identifiability(np.array([1.0, 2.0, 4.0]), [(1, 2)] * 3)
    assert (octaves.rank, len(octaves.unknown), len(octaves.groups)) == (6, 7, 1)
    cubic = identifiability(np.array([1.0, 2.0, 3.0]), [(1, 2, 3)] * 3)
    assert (cubic.rank, len(cubic.unknown)) == (8, 9)
    names, matrix, _ = phase_system(np.array([1.0, 2.0, 3.0]), [(1, 2, 3)] * 3)
    frequency = np.array([float(name.split("(")[1][:-1]) for name in names])
    delay = np.where([name.startswith("phase_front") for name in names], frequency, -frequency)
    assert np.abs(matrix @ delay).max() < 1e-12
    assert not cubic.not_measured
