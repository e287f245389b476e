"""Best linear approximation and the rational fit through it, against filters whose response is known."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from whid.errors import WhidError
from whid.stages._cascade import Filter
from whid.stages.best_linear import best_linear, local_polynomial, realisations
from whid.stages.linear_fit import alternatives, linear_fit, matched

POLES = np.array([0.8 + 0.4j, 0.8 - 0.4j, 0.7])
ZEROS = np.array([0.5 + 0.8j, 0.5 - 0.8j])
NUM, DEN = np.real(np.poly(ZEROS)), np.real(np.poly(POLES))


def record(samples=40_000, std=0.3, seed=1):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(samples)
    return u, lfilter(NUM, DEN, u) + std * rng.standard_normal(samples)


def test_errors_are_what_they_are_said_to_be():
    found = best_linear([record()], 0.1, 512)
    _, true = freqz(NUM, DEN, found.omega * 0.1)
    squares = np.abs(found.response - true) ** 2 / (2 * found.std**2)
    # lines of half-overlapping Hann windows are correlated with their neighbours: some N/1.5 independent ones
    assert np.mean(squares) == pytest.approx(1.0, abs=4 / np.sqrt(len(squares) / 1.5))


def test_stretches_are_joined_in_the_spectra_only():
    u, y = record()
    parts = best_linear([(u[:20_000], y[:20_000]), (u[20_000:], y[20_000:])], 0.1, 512)
    whole = best_linear([(u, y)], 0.1, 512)
    assert parts.averages == whole.averages - 1
    assert np.abs(parts.response - whole.response).max() < whole.std.max()


def test_a_nonlinear_distortion_is_in_the_error():
    u, _ = record()
    clipped = best_linear([(u, np.clip(u, -0.5, 0.5))], 1.0, 256)
    gain = 2 * 0.19146  # Bussgang: the mean slope of the clip under unit Gaussian noise, P(|u| < 0.5)
    z = (clipped.response - gain) / clipped.std
    assert abs(np.mean(z.real)) < 4 / np.sqrt(len(z) / 1.5)


def test_short_records_are_refused():
    with pytest.raises(WhidError, match="windows"):
        best_linear([(np.ones(50), np.ones(50))], 1.0)


def test_poles_zeros_and_orders_are_found():
    bla = best_linear([record()], 0.1, 512)
    fit = min((linear_fit(bla, [n], np.random.default_rng(0)) for n in range(1, 6)), key=lambda f: f.bic.min())
    assert len(fit.poles) == 3
    for true, ours in ((POLES, fit.poles), (ZEROS, fit.zeros[np.abs(np.abs(fit.zeros) - 0.9) < 0.3])):
        np.testing.assert_allclose(np.sort_complex(ours), np.sort_complex(true), atol=0.01)
    assert fit.agreeing == fit.starts
    assert fit.estimate.reduced_chi2 == pytest.approx(1.0, abs=0.35)


def test_a_pair_of_low_q_is_offered_as_a_double_real_pole():
    pair = np.array([0.6 + 0.1j, 0.6 - 0.1j])
    rng = np.random.default_rng(2)
    u = rng.standard_normal(40_000)
    y = lfilter([1.0], np.real(np.poly(pair)), u) + 0.01 * rng.standard_normal(40_000)
    bla = best_linear([(u, y)], 1.0, 512)
    (_, asis), (_, real) = alternatives(linear_fit(bla, [2], np.random.default_rng(0)), bla)
    assert np.abs(asis.imag).max() > 0.05
    np.testing.assert_allclose(real, np.abs(asis[0]))


def test_a_filter_is_matched_at_twice_the_rate():
    slow = Filter.of_roots(np.array([0.2 + 0j]), np.array([0.9 + 0.1j, 0.9 - 0.1j]))
    turn = np.linspace(0.01, 0.8, 200)
    fast = matched(slow.at(turn), turn / 2, 2, 2)
    assert fast.stable
    np.testing.assert_allclose(fast.at(turn / 2), slow.at(turn), atol=2e-3)


def test_a_local_polynomial_sees_a_slow_pole_in_a_short_record():
    """Windows of a record of 600 samples smear a pole of 80 samples; a parabola with its own leakage does not."""
    rng = np.random.default_rng(4)
    pole = np.exp(-1 / 80)
    u = np.convolve(rng.standard_normal(800), np.ones(10) / 10)[:800]
    y = (lfilter([1 - pole], [1, -pole], u) + 1e-3 * rng.standard_normal(800))[200:]
    found = local_polynomial(u[200:], y, 1.0)
    fit = linear_fit(found, [1], np.random.default_rng(0))
    assert np.log(fit.poles[0].real) == pytest.approx(-1 / 80, rel=0.1)


def multisines(curve, std, count=40, periods=6, samples=512, seed=5):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        spectrum = np.zeros(samples // 2 + 1, complex)
        spectrum[1:120] = np.exp(2j * np.pi * rng.random(119))
        u = np.tile(np.fft.irfft(spectrum, samples) * samples / np.sqrt(2 * 119), periods + 1)
        y = lfilter(NUM, DEN, curve(u))[samples:] + std * rng.standard_normal(periods * samples)
        found.append((u[samples:].reshape(periods, samples), y.reshape(periods, samples)))
    return found


def test_realisations_of_a_linear_system_scatter_by_noise_alone():
    found = realisations(multisines(lambda u: u, 0.3), 0.1)
    _, true = freqz(NUM, DEN, found.omega * 0.1)
    assert len(found.omega) == 119
    squares = np.abs(found.response - true) ** 2 / (2 * found.std**2)
    assert np.mean(squares) == pytest.approx(1.0, abs=4 / np.sqrt(119))
    assert np.mean(found.noise**2 / found.std**2) == pytest.approx(1.0, abs=0.15)


def test_realisations_tell_distortion_from_noise():
    quiet = realisations(multisines(lambda u: np.clip(u, -0.5, 0.5), 1e-3), 0.1)
    assert np.median(quiet.noise / quiet.std) < 0.1
    _, true = freqz(NUM, DEN, quiet.omega * 0.1)
    gain = quiet.response / true  # the clip's Bussgang gain, P(|u| < 0.5), up to 1/lines for a sum of 119 sines
    assert np.mean(gain.real) == pytest.approx(2 * 0.19146, abs=0.01)
