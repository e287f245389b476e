"""What every disturbance promises: unit variance, the covariance it names, stationarity, one size."""

import dataclasses

import numpy as np
import pytest

from tests.disturbances.examples import EXAMPLES
from whid.disturbances._disturbance import Disturbance
from whid.disturbances.ar import Ar
from whid.errors import WhidError
from whid.kinds import plain

DT, SAMPLES, LAGS = 0.1, 200_000, 12
CASES = [pytest.param(d, id=f"{kind}-{k}") for kind, many in EXAMPLES.items() for k, d in enumerate(many)]


@pytest.mark.parametrize("kind", Disturbance.kinds())
def test_every_kind_has_an_example_and_a_summary(kind):
    assert kind in EXAMPLES, f"add an example of {kind!r} to tests/disturbances/examples.py"
    assert Disturbance.named(kind).summary()


@pytest.mark.parametrize("disturbance", CASES)
def test_a_long_draw_has_the_covariance(disturbance):
    """Bartlett: the sample autocovariance at lag k has variance (1/N) Σ_m (r_m² + r_{m+k} r_{m−k}); 4.5 of those."""
    e = disturbance.draw(SAMPLES, DT, np.random.default_rng(11))
    r = disturbance.covariance(600, DT)
    assert r[0] == pytest.approx(1.0, abs=1e-12)
    two_sided = np.concatenate([r[:0:-1], r])
    centre = len(r) - 1
    for k in range(LAGS):
        sample = np.mean(e[: SAMPLES - k] * e[k:])
        m = np.arange(-(centre - k), centre - k + 1)
        variance = np.sum(two_sided[centre + m] ** 2 + two_sided[centre + m + k] * two_sided[centre + m - k]) / SAMPLES
        assert abs(sample - r[k]) < 4.5 * np.sqrt(variance)


@pytest.mark.parametrize("disturbance", CASES)
def test_the_first_sample_is_like_the_last(disturbance):
    """Stationary from the start: over 4000 draws the variance of any sample is 1 within 4.5 standard errors."""
    rng = np.random.default_rng(12)
    e = np.array([disturbance.draw(30, DT, rng) for _ in range(4000)])
    kurtosis = np.mean(e**4)  # 3 of Gaussian noise; wild samples have more
    assert np.all(np.abs(np.mean(e**2, axis=0) - 1) < 4.5 * np.sqrt((kurtosis - 1) / 4000))
    r = disturbance.covariance(2, DT)[1]
    assert abs(np.mean(e[:, 0] * e[:, 1]) - r) < 4.5 * np.sqrt((1 + r**2) / 4000)


@pytest.mark.parametrize("disturbance", CASES)
@pytest.mark.parametrize("samples", [0, 1, 2, 5])
def test_short_draws(disturbance, samples):
    assert disturbance.draw(samples, DT, np.random.default_rng(0)).shape == (samples,)
    assert disturbance.covariance(max(samples, 1), DT).shape == (max(samples, 1),)


@pytest.mark.parametrize("disturbance", CASES)
def test_the_size_is_given_once(disturbance):
    for size in ({"std": None, "snr_db": None}, {"std": 1.0, "snr_db": 10.0}):
        with pytest.raises(WhidError) as fault:
            dataclasses.replace(disturbance, **size)
        assert fault.value.code == "disturbance-size"


@pytest.mark.parametrize("disturbance", CASES)
def test_plain_round_trips(disturbance):
    fields = {k: tuple(v) if isinstance(v, list) else v for k, v in plain(disturbance).items() if k != "kind"}
    assert type(disturbance)(**fields) == disturbance


def test_snr_is_of_the_undisturbed_output_without_its_mean():
    x = 100 + np.sin(np.arange(1000.0))
    assert EXAMPLES["white"][1].scale(x) == pytest.approx(np.sqrt(np.var(x) / 1e4), rel=1e-12)
    assert EXAMPLES["white"][0].scale(x) == 0.5


@pytest.mark.parametrize("coefficients", [(1.0,), (-1.1,), (0.5, 0.5), (1.0, -1.0)])
def test_growing_noise_is_refused(coefficients):
    with pytest.raises(WhidError) as fault:
        Ar(coefficients=coefficients, std=1.0)
    assert fault.value.code == "disturbance-unstable"


def test_first_and_second_order_by_hand():
    np.testing.assert_allclose(Ar(coefficients=(0.7,), std=1.0).covariance(5, DT), 0.7 ** np.arange(5), atol=1e-14)
    a, b = 1.1, -0.4
    r = [1.0, a / (1 - b)]
    r.append(a * r[1] + b)
    np.testing.assert_allclose(Ar(coefficients=(a, b), std=1.0).covariance(3, DT), r, atol=1e-14)
    assert Ar(coefficients=(a, b), std=1.0).covariance(1, DT).tolist() == [1.0]
