"""Harmonics of w = f(v) for v = offset + amplitude·cos θ, f a piecewise polynomial, and their derivatives."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class InnerHarmonics(NamedTuple):
    """A_k of w = Σ_k A_k cos kθ, k = 0 … K, for E sines, and how it changes."""

    value: Floats  # (E, K + 1)
    by_amplitude: Floats  # (E, K + 1)
    by_coefficient: Floats  # (E, K + 1, S + 1, d + 1)
    by_break: Floats  # (E, K + 1, S)


@lru_cache
def _nodes(count: int) -> tuple[Floats, Floats]:
    x, w = leggauss(count)
    return (x + 1) / 2, w / 2


def inner_harmonics(breaks: Floats, coefficients: Floats, offset: Floats, amplitude: Floats, highest: int) -> InnerHarmonics:
    """Return A_k = (2/π) ∫₀^π f(offset + amplitude·cos θ) cos kθ dθ (half of it for k = 0), k = 0 … highest.

    breaks (S,) ascending, coefficients (S + 1, d + 1) ascending powers of v, zero-padded, offset (E,), amplitude (E,) > 0.
    From θ = 0 down the sine passes the pieces from the last to the first; each arc (empty where a break is out of reach) is
    integrated by enough Gauss-Legendre nodes to be exact to rounding.
    Source [Brouri2019], eqs. (3.21)-(3.23); [PAPERS A, build 6].

    >>> square = np.array([[0.0, 0.0, 1.0]])
    >>> inner_harmonics(np.empty(0), square, np.array([2.0]), np.array([1.0]), 2).value.round(12)  # (2 + cos θ)²
    array([[4.5, 4. , 0.5]])
    """
    e, k, (pieces, size) = len(offset), np.arange(highest + 1), coefficients.shape
    factor = np.where(k == 0, 1.0, 2.0) / np.pi
    level = (breaks[::-1] - offset[:, None]) / amplitude[:, None]
    edges = np.hstack([np.zeros((e, 1)), np.arccos(np.clip(level, -1, 1)), np.full((e, 1), np.pi)])
    x, w = _nodes(14 + (highest + size) * 3 // 2)
    width = np.diff(edges, axis=1)[..., None]
    theta = edges[:, :-1, None] + width * x  # (E, S + 1, nodes), pieces from the last to the first
    cos = np.cos(theta)
    powers = (offset[:, None, None] + amplitude[:, None, None] * cos)[..., None] ** np.arange(size)
    own = coefficients[::-1]
    slope = np.einsum("eanp,ap->ean", powers[..., :-1], own[:, 1:] * np.arange(1, size))
    cosines = np.cos(k[:, None, None, None] * theta) * (width * w)  # (K + 1, E, S + 1, nodes)
    by_coefficient = (np.einsum("kean,eanp->ekap", cosines, powers) * factor[:, None, None])[:, :, ::-1]
    value = np.einsum("ekap,ap->ek", by_coefficient, coefficients)
    by_amplitude = np.einsum("kean,ean->ek", cosines, slope * cos) * factor
    by_break = np.zeros((e, len(k), pieces - 1))
    for j, b in enumerate(breaks):
        inside = np.abs(b - offset) < amplitude
        angle = np.arccos((b - offset[inside]) / amplitude[inside])
        jump = float(np.polynomial.polynomial.polyval(b, coefficients[j + 1] - coefficients[j]))
        # above the break (θ < angle) f is the upper piece: A = ∫₀^angle upper + ∫_angle^π lower
        moved = factor * np.cos(k * angle[:, None]) * (jump / (amplitude[inside] * np.sin(angle)))[:, None]
        by_break[inside, :, j] = -moved
        by_amplitude[inside] += moved * np.cos(angle)[:, None]
    return InnerHarmonics(value, by_amplitude, by_coefficient, by_break)


def held_sine(amplitude: float, phase: float, omega: float, dt: float, intersample: str) -> complex:
    """Return the phasor of the continuous sine that acts on the plant when samples of a cosine are held or joined.

    zoh: the held staircase has the fundamental sinc(ωh/2)·e^{−jωh/2} of the cosine; foh: sinc². Its images around the
    sampling frequency are left out.

    >>> abs(held_sine(1.0, 0.0, 0.1, 1.0, "zoh") - np.sinc(0.05 / np.pi) * np.exp(-0.05j)) < 1e-15
    np.True_
    """
    half = omega * dt / 2
    hold = {"zoh": np.sinc(half / np.pi) * np.exp(-1j * half), "foh": np.sinc(half / np.pi) ** 2}
    return complex(amplitude * np.exp(1j * phase) * hold.get(intersample, 1.0))
