"""Orders and delay from a frequency response; what happens to unstable or missing models."""

import numpy as np
import pytest

from tests.brouri2014 import response
from whid.errors import WhidError
from whid.stages.transfer_function import transfer_function

OMEGA = np.array([0.2, 0.4, 0.8, 1.2, 1.6, 2.4, 3.2, 4.5, 6.4])


def found(which, seed, size=2e-3):
    rng = np.random.default_rng([9, seed])
    g = response(which, OMEGA) / abs(response(which, 0.0))
    std = size / np.abs(g)
    noise = std * rng.standard_normal((2, len(OMEGA)))
    covariance = np.diag(np.tile(std**2, 2))
    return transfer_function(OMEGA, np.log(np.abs(g)) + noise[0], np.angle(g) + noise[1], covariance, 20_000)


@pytest.mark.parametrize(("which", "orders", "truth"), [
    ("A1", (0, 3, 0), (1.3, 0.55, 0.25)), ("A2", (0, 2, 1), (0.8, 0.5, 0.4))
])  # fmt: skip
def test_orders_delay_and_errors(which, orders, truth):
    z = []
    for seed in range(2):
        g = found(which, seed)
        assert tuple(g.tried[np.argmin(g.bic)]) == orders
        z.append((g.estimate.values - truth) / g.estimate.std)
    assert np.mean(np.square(z)) < 3.0  # mean of 6 squares, χ²₆ = 18 at 6e-3


def test_a_lag_of_wrapped_phase_is_a_delay():
    """Ten radians of phase: the delay is found although every phase is given modulo 2π."""
    g = np.exp(-1.6j * OMEGA) / (1 + 0.3j * OMEGA)
    got = transfer_function(OMEGA, np.log(np.abs(g)), np.angle(g), 1e-6 * np.eye(18), 1000)
    assert got.delay == pytest.approx(1.6, abs=1e-3)
    assert got.den == pytest.approx([0.3, 1.0], abs=1e-3)
    assert got.num.tolist() == [1.0]


def exact(g, **options):
    return transfer_function(OMEGA, np.log(np.abs(g)), np.angle(g), 1e-6 * np.eye(18), 1000, **options)


def test_no_dynamics_are_no_dynamics():
    got = exact(np.ones(9, complex))
    assert (got.num.tolist(), got.den.tolist(), got.delay, got.estimate.names) == ([1.0], [1.0], 0.0, ())


def test_a_pole_faster_than_a_sample_is_a_delay():
    """Nothing tells 1/(1 + 1e-3 s) from a delay of 1 ms below 6.4 rad/s; with samples 20 ms apart it is no pole."""
    got = exact(1 / (1 + 1e-3j * OMEGA) / (1 + 0.5j * OMEGA), shown=(0.02, 100.0))
    assert len(got.den) == 2
    assert got.delay == pytest.approx(1e-3, rel=1e-2)
    assert got.den[0] == pytest.approx(0.5, abs=1e-4)


def test_a_pole_slower_than_the_record_is_refused_by_name():
    g = 1 / (1 + 300j * OMEGA)
    assert exact(g, shown=(0.02, 1000.0)).den[0] == pytest.approx(300, rel=0.01)
    with pytest.raises(WhidError, match=r"outside 0\.02 … 100 s") as fault:
        exact(g, shown=(0.02, 100.0), highest=1)
    assert fault.value.code == "stage-unseen-pole"
    assert "lower frequency" in fault.value.remedy
