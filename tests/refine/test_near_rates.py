"""A fit whose derivatives are those of a near model: where it ends, against one with its own."""

import numpy as np
import pytest

from whid.blocks.feedback import Feedback
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.predict import input_signal, predict
from whid.record import Record
from whid.refine import refine
from whid.system import System

DT, STD = 0.2, 0.05


def loop(gain, tau):
    forward = Linear(num=(gain,), den=(tau, 1.0), fix=("den.1",))
    back = Polynomial(coefficients=(0.0, 0.1, 0.0, 0.02), fix=("coefficients.0", "coefficients.2"))
    return System(chain=(Feedback(forward=forward, back=back, solve="continuous"),))


@pytest.mark.parametrize("seed", [11, pytest.param(12, marks=pytest.mark.slow), pytest.param(13, marks=pytest.mark.slow)])
def test_it_ends_as_near_the_minimum_as_the_derivatives_are(seed):
    """J̃ᵀr = 0 in place of Jᵀr = 0 moves the fit by (JᵀJ̃)⁻¹(J̃ − J)ᵀr: standard errors times what the spaces are apart."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, 20), 15)
    blank = Record(u=u, y=np.zeros(len(u)), dt=DT)
    y = predict(loop(1.5, 1.0).tree, blank)
    record = Record(u=u, y=y + STD * rng.standard_normal(len(u)), dt=DT)
    exact, near = (refine(loop(1.2, 1.3), [record], rates=rates, std=[STD]).estimate for rates in ("", "sampled"))
    assert near.why_stop == "converged"
    tree = loop(1.5, 1.0).tree
    spaces = []
    for path in ("exact", "sampled"):
        u_in = input_signal(tree, record, path)
        spaces.append(np.linalg.qr(np.array([t.values for t in tree.tangent(u_in, [], exact.names).tangents]).T)[0])
    apart = np.sqrt(1 - np.linalg.svd(spaces[0].T @ spaces[1], compute_uv=False).min() ** 2)  # sine of the largest angle
    assert 0.01 < apart < 0.3
    assert np.all(np.abs(near.values - exact.values) < 4 * apart * exact.std)
    assert 0 < near.chi2 - exact.chi2 < len(exact.names) * (4 * apart) ** 2
    np.testing.assert_allclose(near.std, exact.std, rtol=2 * apart)
