"""The plants B1-B5 behind G1, their sines, and averaged periods of them made without the simulator."""

import numpy as np

from tests.blocks.backlash_reference import first_contact

B1 = ((-0.15, 1.0, 0.0, 0.05), (0.15, 1.0, 0.0, 0.05))
B2 = ((-0.3, 0.7, 0.8, -0.8), (-0.2, 0.7, 0.7, -0.1))
B3 = ((0.2, 1.0, 0.5, -0.6), (0.2, 1.0, 0.5, -0.6))
B4 = ((0.15, 1.0, 0.0, 0.0), (-0.15, 1.0, 0.0, 0.0))
OMEGA = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5)
AMPLITUDES = (1.0, 1.5)


def g1(omega):
    s = 1j * np.asarray(omega)
    return 1 / ((1 + s) * (1 + 0.3 * s + 0.25 * s**2))


def period(borders, omega, amplitude, samples=256):
    """One settled period of w for u = amplitude·cos ωt, by the per-sample rule on the exact sine, turning points put in."""
    g = g1(omega)
    theta = 2 * np.pi * np.arange(3 * samples) / samples + np.angle(g)
    turns = np.pi * np.arange(np.ceil(theta[0] / np.pi), theta[-1] / np.pi)
    both = np.sort(np.concatenate([theta, turns]))
    fine = np.unique(np.concatenate([both, *(both[:-1] + k / 5 * np.diff(both) for k in range(1, 5))]))
    w = first_contact(amplitude * abs(g) * np.cos(fine), *borders)
    return w[np.searchsorted(fine, theta[-samples:])]


def noise_std(w, snr_db):
    return float(np.std(w) * 10 ** (-snr_db / 20))
