"""The plant and input of [Jeraj and Mathews], section 4, without the run around them."""

import numpy as np

from whid.experiments.noise_band import NoiseBand

SAMPLES, ORDER, DOMAIN = 50_000, 7, (-1.0, 1.0)
TRUE = np.array([0, 0.8399875, 0, 0.13334375, 0, 0.02666875, 0, 0])  # of 0.4267 x⁵ + 0.5733 x
GRID = np.cos(np.linspace(0, np.pi, 2001))


def g(x):
    square = x * x
    return x * (0.5733 + 0.4267 * square * square)


def inputs(rng, samples=SAMPLES, std=1 / 3):
    return NoiseBand(band=(0.39, 0.59), std=std, duration_s=samples).input(1.0, rng)


def noisy(w, snr_db, rng):
    """The output with white noise, and its standard deviation; None: no noise."""
    std = 0.0 if snr_db is None else w.std() * 10 ** (-snr_db / 20)
    return (w + std * rng.standard_normal(len(w)) if std else w), std


def record(seed, snr_db=20.0, samples=SAMPLES, curve=g):
    rng = np.random.default_rng(seed)
    x = inputs(rng, samples)
    return (x, *noisy(curve(x), snr_db, rng))


def largest_error(coefficients, curve=g):
    """On [−1, 1]."""
    return np.abs(np.polynomial.chebyshev.chebval(GRID, coefficients) - curve(GRID)).max()
