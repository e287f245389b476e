"""Tones in noise: frequency and amplitude against the Cramér-Rao bound, no tone where there is none."""

import numpy as np
import pytest

from whid.stages.interference import interference

N, DT = 20_000, 1e-3
EVERYWHERE = np.ones(N, bool)


def noise(seed):
    return np.random.default_rng(seed).standard_normal(N)


def test_a_tone_and_its_third_harmonic_within_their_errors():
    time, omega = DT * np.arange(N), 2 * np.pi * 50.037
    z, said = [], []
    for seed in range(20):
        e = noise(seed) + 0.2 * np.cos(omega * time + 0.4) + 0.1 * np.sin(3 * omega * time)
        found = interference(e, EVERYWHERE, DT)
        assert found.harmonics.tolist() == [1, 3]
        z.append((found.omega - omega) / found.omega_std)
        said.append(found.omega_std)
        assert found.after == pytest.approx(1.0, abs=5 / np.sqrt(2 * N))
    assert np.mean(np.square(z)) < 1 + 4 * np.sqrt(2 / 20)
    # Rife and Boorstyn 1974: var ω = 24σ²/(A²·T²·N), with the harmonic's help A² + 9·A₃²; each is said at amplitudes that
    # are known to 0.01, which moves it by 7 %
    bound = np.sqrt(24 / ((0.2**2 + 9 * 0.1**2) * (N * DT) ** 2 * N))
    assert np.mean(said) == pytest.approx(bound, rel=3 * 0.07 / np.sqrt(20))


def test_noise_has_no_tone():
    assert not any(interference(noise(100 + seed), EVERYWHERE, DT).found for seed in range(20))


def test_drift_is_no_tone():
    walk = np.cumsum(noise(1)) / 100
    assert not interference(walk + noise(2), EVERYWHERE, DT).found


def test_holes_do_not_matter():
    use = EVERYWHERE.copy()
    use[5000:9000] = False
    omega = 2 * np.pi * 120.5
    e = noise(3) + 0.2 * np.cos(omega * DT * np.arange(N))
    e[~use] = np.nan
    found = interference(e, use, DT)
    assert found.omega == pytest.approx(omega, abs=4 * found.omega_std)
    assert found.cos[0] == pytest.approx(0.2, abs=0.05)
