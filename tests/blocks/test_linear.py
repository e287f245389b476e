"""Linear blocks against references that share no code: scipy and control, closed forms."""

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, lfilter

from whid.blocks.chain import Chain
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.errors import WhidError
from whid.signal import held

RNG = np.random.default_rng(7)
U = RNG.standard_normal(200)
DT = 0.1

SYSTEMS = {
    "lag": ([2.0], [1.0, 0.5]),
    "feedthrough": ([1.0, 3.0, 2.0], [2.0, 1.0, 5.0]),
    "integrator": ([1.0], [1.0, 0.0]),
    "double integrator": ([1.0], [1.0, 0.0, 0.0]),
    "resonance": ([4.0], [1.0, 0.02, 4.0]),
    "repeated": ([16.0], list(np.poly([-2.0] * 4))),
    "stiff": ([300.0, 300.0], list(np.poly([-300.0, -1.0]))),
    "order 6": ([1.0, 0.0, 3.0], list(np.poly([-1, -2, -0.5 + 3j, -0.5 - 3j, -1 + 1j, -1 - 1j]).real)),
    "order 8": ([5.0], list(np.poly([-1, -1.1, -1.2, -1.3, -0.5 + 3j, -0.5 - 3j, -4, -5]).real)),
}


def reference(num, den, u):
    """The response to a held input by scipy's discretisation of control's realisation."""
    state = control.ss(control.tf(num, den))
    *system, _ = cont2discrete((state.A, state.B, state.C, state.D), DT, "zoh")
    return dlsim((*system, DT), u)[1][:, 0]


@pytest.mark.parametrize("course", ["discrete", "zoh"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_response_is_exact(name, course):
    num, den = SYSTEMS[name]
    block = Linear(num=tuple(num), den=tuple(den))
    expected = reference(num, den, U)
    np.testing.assert_allclose(block(U, DT, course), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", SYSTEMS)
def test_straight_lines_are_exact(name):
    """A first-order hold is a sum of delayed ramps: the response is found from the ramp's, held on a 50 times finer grid."""
    num, den = SYSTEMS[name]
    block = Linear(num=tuple(num), den=tuple(den))
    u = np.cumsum(U[:30]) - U[0]
    fine = np.interp(np.arange(29 * 400 + 1) / 400, np.arange(30), u)
    middle = np.append((fine[1:] + fine[:-1]) / 2, fine[-1])  # the mean of a straight line: error O(h²)
    out = block.step(held(u, DT, "foh", order=block.panel_order(DT)))[0].values
    expected = block(middle, DT / 400, "zoh")[::400] + block.state_space().d * (u - middle[::400])
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("stiffness", [0.01, 1.0, 5.0, 30.0])
def test_a_smooth_input_is_followed_at_any_stiffness(stiffness):
    """Product integration: a cosine through a lag, |λ|·dt up to 30, in closed form."""
    rate, omega, n = stiffness / DT, 2 * np.pi / (40 * DT), np.arange(81)
    block = Linear(num=(rate,), den=(1.0, rate))
    u = np.cos(omega * DT * n)
    y = block.step(held(u, DT, "bandlimited", order=block.panel_order(DT)))[0].values
    g = rate / (rate + 1j * omega)
    expected = np.real(g * np.exp(1j * omega * DT * n)) - np.real(g) * np.exp(-rate * DT * n)
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("stiffness", [1.0, 30.0])
def test_what_it_does_between_samples(stiffness):
    """The course between samples of a held step, cubed: e^{−λt} in closed form at every node, through the cube."""
    rate = stiffness / DT
    block = Linear(num=(rate,), den=(1.0, rate))
    cube = Chain(chain=(block, Polynomial(coefficients=(0.0, 0.0, 0.0, 1.0)), Linear(num=(1.0,), den=(1.0, 0.0))))
    y = cube(np.ones(30), DT, "zoh")
    t = DT * np.arange(30)
    expected = t - sum(c / (k * rate) * (1 - np.exp(-k * rate * t)) for k, c in ((1, 3), (2, -3), (3, 1)))
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-10)


def test_discrete_blocks_are_lfilter():
    block = Linear(num=(0.2, 0.1), den=(1.0, -1.2, 0.5), dt=DT)
    np.testing.assert_allclose(block(U, DT, "discrete"), lfilter([0.0, 0.2, 0.1], [1.0, -1.2, 0.5], U), atol=1e-12)
    with pytest.raises(WhidError, match=r"dt 0\.1 s met a signal of dt 0\.2 s"):
        block(U, 0.2)


def test_all_forms_agree():
    omega = np.array([0.0, 0.3, 2.0, 50.0])
    forms = [
        Linear(num=(2.0, 6.0), den=(1.0, 3.0, 2.0)),
        Linear(zeros=(-3.0,), poles=(-1.0, -2.0), gain=2.0),
        Linear(A=((-3.0, -2.0), (1.0, 0.0)), B=(1.0, 0.0), C=(2.0, 6.0)),
        Linear.of(control.tf([2.0, 6.0], [1.0, 3.0, 2.0])),
        Linear.of(control.ss(control.tf([2.0, 6.0], [1.0, 3.0, 2.0]))),
    ]
    for form in forms:
        np.testing.assert_allclose(form.gain_at(omega), forms[0].gain_at(omega), rtol=1e-12)
        np.testing.assert_allclose(form(U, DT), forms[0](U, DT), atol=1e-12)
        np.testing.assert_allclose(form.control()(1j * omega[1:]), forms[0].gain_at(omega[1:]), rtol=1e-12)


def test_no_steady_state_has_a_name():
    for den in ((1.0, 0.0), (1.0, 0.0, 0.0)):
        block = Linear(num=(1.0,), den=den)
        with pytest.raises(WhidError) as fault:
            block.steady(1.0, DT)
        assert fault.value.code == "block-no-steady-state"
        assert block.steady(0.0, DT)[0] == 0.0


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"num": (1.0,)},
        {"num": (1.0,), "den": (1.0,), "poles": (-1.0,)},
        {"num": (1.0, 0.0, 0.0), "den": (1.0, 1.0)},
        {"num": (1.0,), "den": (0.0, 1.0)},
        {"zeros": (1.0, 2.0), "poles": (-1.0,)},
        {"A": ((1.0, 2.0),), "B": (1.0,), "C": (1.0,)},
    ],
)
def test_impossible_blocks_are_refused(fields):
    with pytest.raises(WhidError) as fault:
        Linear(**fields)
    assert fault.value.code == "block-parameters"
