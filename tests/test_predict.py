"""The response of a tree, and the initial state that a record leaves free."""

from dataclasses import replace

import numpy as np
import pytest

from whid.blocks.chain import Chain
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.blocks.saturation import Saturation
from whid.predict import input_signal, predict, respond
from whid.record import Record

FRONT = Linear(num=(1.0,), den=(1.0, 0.6, 1.0))  # a complex pair
BACK = Linear(num=(1.0,), den=(2.0, 1.0))


def moving_record(tree, seed, noise):
    """A record that starts in the middle of a movement: its first 300 samples are cut off."""
    u = np.repeat(np.random.default_rng(seed).uniform(-2, 2, 20), 50)
    y = respond(tree, input_signal(tree, Record(u=u, y=u, dt=0.1)))[0]
    y = y + noise * np.random.default_rng(seed + 1).standard_normal(len(y))
    return Record(u=u[300:], y=y[300:], dt=0.1, initial="free")


@pytest.mark.parametrize(
    "tree",
    [
        Chain(chain=(FRONT, BACK)),
        Chain(chain=(FRONT, Polynomial(coefficients=(0.0, 1.0, 0.2)), BACK)),
        Chain(chain=(BACK, FRONT)),
    ],
)
def test_a_free_state_removes_the_transient(tree):
    record = moving_record(tree, 3, 0.0)
    assert np.abs(predict(tree, record) - record.y).max() < 1e-6
    assert np.abs(predict(tree, replace(record, initial="steady")) - record.y).max() > 0.1


def test_a_free_state_costs_as_many_degrees_as_it_has_numbers():
    """Residual of a fit of 3 numbers to noise: χ² with n − 3 degrees of freedom, nothing of the transient left in it."""
    tree = Chain(chain=(FRONT, Saturation(low=-1.5, high=1.5), BACK))
    record = moving_record(tree, 5, 0.05)
    left = predict(tree, record) - record.y
    n = len(left)
    assert abs(np.sum(left**2) / 0.05**2 - (n - 3)) < 4 * np.sqrt(2 * n)


def test_missing_samples_are_skipped_and_the_state_goes_on():
    tree = Chain(chain=(FRONT, BACK))
    record = moving_record(tree, 7, 0.0)
    valid = np.random.default_rng(0).random(len(record)) > 0.3
    holes = replace(record, y=np.where(valid, record.y, np.nan), valid=valid)
    assert np.abs(predict(tree, holes) - record.y).max() < 1e-6


def test_an_integrator_may_be_free_but_not_steady():
    from whid.errors import WhidError

    tree = Linear(num=(1.0,), den=(1.0, 0.0))
    u = np.ones(50)
    record = Record(u=u, y=3.0 + 0.1 * np.arange(50), dt=0.1, initial="free")
    assert np.allclose(predict(tree, record), record.y, atol=1e-6)
    with pytest.raises(WhidError, match="no steady state"):
        predict(tree, replace(record, initial="steady"))
