"""The pooled autoregression against processes whose autocovariance is known in closed form."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from whid.stages._noise import estimate_noise, quantisation_variance, quantum_of


def ar1(rho, std, shape, seed):
    noise = np.random.default_rng(seed).normal(size=(*shape[:-1], shape[-1] + 300))
    return std * lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise)[..., 300:]


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, -0.6])
def test_long_run_variance_is_unbiased_on_short_stretches(rho, degree):
    """60 records of 16 stretches of 100 samples, where the uncorrected estimate is 20-60 % too small at rho = .9."""
    found = [estimate_noise(list(ar1(rho, 0.5, (16, 100), seed)), degree) for seed in range(60)]
    variances = np.array([noise.long_run_variance for noise in found])
    truth = 0.25 * (1 + rho) / (1 - rho)
    print(f"rho {rho}, degree {degree}: long-run variance {variances.mean():.4f} of {truth:.4f}")
    assert abs(np.median(variances) / truth - 1) < 0.08


def test_variance_of_a_mean_is_that_of_the_covariance_matrix():
    noise = estimate_noise(list(ar1(0.8, 1.0, (10, 300), 1)))
    for n in (1, 7, 300):
        matrix = toeplitz(noise.autocovariance[:n])
        assert noise.variance_of_mean(np.array([n]))[0] == pytest.approx(matrix.sum() / n**2, rel=1e-10)
    valid = np.random.default_rng(2).random(300) < 0.6
    inside = toeplitz(noise.autocovariance)[np.ix_(valid, valid)]
    assert noise.variance_of_masked_mean(valid) == pytest.approx(inside.sum() / valid.sum() ** 2, rel=1e-10)


def test_the_loss_from_removing_a_trend_is_exact():
    """E Σ r(t) r(t + k) of a detrended stretch with holes, by explicit matrices."""
    from whid.stages._noise import _lost, _trend

    gamma = 0.7 ** np.arange(60)
    valid = np.random.default_rng(3).random(60) < 0.8
    q = _trend(valid, 2)
    mask = np.diag(valid.astype(float))
    project = mask - q @ q.T
    covariance = toeplitz(gamma)
    for k in range(5):
        shift = np.eye(60, k=k)
        kept = np.trace(shift @ project @ covariance @ project)
        whole = np.trace(shift @ mask @ covariance @ mask)
        assert _lost([q], gamma, 5)[k] == pytest.approx(whole - kept, abs=1e-10)


def test_missing_samples_leave_the_estimate_unbiased():
    holds = ar1(0.9, 1.0, (16, 400), 5)
    holds[np.random.default_rng(6).random(holds.shape) < 0.3] = np.nan
    assert estimate_noise(list(holds)).long_run_variance == pytest.approx(19, rel=0.3)  # 3 sd of 6400·0.7² pairs


def test_order_of_a_second_order_process():
    noise = np.random.default_rng(7).normal(size=(8, 2300))
    holds = lfilter([1], [1, -1.2, 0.5], noise)[:, 300:]
    found = estimate_noise(list(holds))
    assert found.ar == pytest.approx([1.2, -0.5], abs=4 * np.sqrt(0.75 / 16000))


def test_unequal_noise_is_seen_and_kept_apart():
    std = np.array([1.0, 1.0, 0.1, 2.0])
    holds = std[:, None] * ar1(0.5, 1.0, (4, 500), 8)
    found = estimate_noise(list(holds))
    size = found.scale * found.autocovariance[0]
    assert np.sqrt(size) == pytest.approx(std, rel=0.15)
    assert np.all(estimate_noise(list(ar1(0.5, 1.0, (4, 500), 9))).scale == 1)


def test_noise_free_stretches():
    found = estimate_noise([np.full(50, 3.0), np.full(60, -2.0)])
    assert found.long_run_variance < 1e-20


def test_quantum():
    fine = np.random.default_rng(0).normal(size=5000)
    assert quantum_of(fine) == 0
    assert quantum_of(np.round(fine / 0.02) * 0.02) == pytest.approx(0.02)
    assert quantum_of(np.round(fine, 6)) == 0
    assert quantum_of(np.full(10, 2.0)) == 0


@pytest.mark.parametrize("ratio", [0.0, 0.2, 0.35, 0.5])
def test_quantisation_error_of_a_mean(ratio):
    """Mean square of E[round(m + e)] − m over m uniform in a step, by numerical integration."""
    from scipy.stats import norm

    m = (np.arange(400) + 0.5) / 400
    codes = np.arange(-6, 8)
    edges = np.concatenate([[-np.inf], codes[:-1] + 0.5, [np.inf]])
    chance = np.diff(norm.cdf((edges[None] - m[:, None]) / max(ratio, 1e-9)), axis=1)
    mean, square = chance @ codes, chance @ codes**2
    bias = np.mean((mean - m) ** 2)
    std = np.sqrt(np.mean(square - mean**2))
    if ratio in (0.0, 0.5):  # in between, a rounded signal no longer tells its own noise exactly
        expected = quantisation_variance(np.array([std]), 1.0)[0]
        assert expected == pytest.approx(bias, rel=0.05, abs=2e-4)
    assert quantisation_variance(np.array([std]), 1.0)[0] >= 0.9 * bias
