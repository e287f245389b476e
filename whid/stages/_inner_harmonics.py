"""Harmonics of w = f(v) for v = offset + amplitude·cos θ, f a piecewise polynomial, and their derivatives."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class InnerHarmonics(NamedTuple):
    """A_k of w = Σ_k A_k cos kθ, k = 0 … K, and how it changes."""

    value: Floats  # (K + 1,)
    by_amplitude: Floats  # (K + 1,)
    by_coefficient: Floats  # (K + 1, S + 1, d + 1)
    by_break: Floats  # (K + 1, S)


@lru_cache
def _nodes(count: int) -> tuple[Floats, Floats]:
    x, w = leggauss(count)
    return (x + 1) / 2, w / 2


def inner_harmonics(breaks: Floats, coefficients: Floats, offset: float, amplitude: float, highest: int) -> InnerHarmonics:
    """Return A_k = (2/π) ∫₀^π f(offset + amplitude·cos θ) cos kθ dθ (half of it for k = 0), k = 0 … highest.

    breaks (S,) ascending, coefficients (S + 1, d + 1) ascending powers of v, zero-padded. Each smooth arc is integrated by
    enough Gauss-Legendre nodes to be exact to rounding. Source [Brouri2019], eqs. (3.21)-(3.23); [PAPERS A, build 6].

    >>> inner_harmonics(np.empty(0), np.array([[0.0, 0.0, 1.0]]), 2.0, 1.0, 2).value.round(12)  # (2 + cos θ)²
    array([4.5, 4. , 0.5])
    """
    k = np.arange(highest + 1)
    factor = np.where(k == 0, 1.0, 2.0) / np.pi
    inside = np.abs(breaks - offset) < amplitude
    crossings = np.arccos((breaks[inside] - offset) / amplitude)[::-1]  # ascending θ
    edges = np.concatenate([[0.0], crossings, [np.pi]])
    count = 12 + (highest + coefficients.shape[1]) * 3 // 2 // max(1, len(edges) - 2) + 8
    x, w = _nodes(count)
    theta = edges[:-1, None] + np.diff(edges)[:, None] * x
    weight = np.diff(edges)[:, None] * w
    v = offset + amplitude * np.cos(theta)
    middle = offset + amplitude * np.cos((edges[:-1] + edges[1:]) / 2)
    piece = np.searchsorted(breaks, middle)
    powers = v[..., None] ** np.arange(coefficients.shape[1])  # (arcs, nodes, d + 1)
    f = np.einsum("anp,ap->an", powers, coefficients[piece])
    degree = np.arange(1, coefficients.shape[1])
    slope = np.einsum("anp,ap->an", powers[..., :-1], coefficients[piece, 1:] * degree)
    cosines = np.cos(k[:, None, None] * theta) * weight  # (K + 1, arcs, nodes)
    value = factor * np.einsum("kan,an->k", cosines, f)
    by_amplitude = factor * np.einsum("kan,an->k", cosines, slope * np.cos(theta))
    by_coefficient = np.zeros((len(k), *coefficients.shape))
    for arc, place in enumerate(piece):
        by_coefficient[:, place] += factor[:, None] * np.einsum("kn,np->kp", cosines[:, arc], powers[arc])
    by_break = np.zeros((len(k), len(breaks)))
    for j in np.flatnonzero(inside):
        angle = np.arccos((breaks[j] - offset) / amplitude)
        jump = float(np.polynomial.polynomial.polyval(breaks[j], coefficients[j + 1] - coefficients[j]))
        # above the break (θ < angle) f is the upper piece: A = ∫₀^angle upper + ∫_angle^π lower
        speed = amplitude * np.sin(angle)
        by_break[:, j] = -factor * np.cos(k * angle) * jump / speed
        by_amplitude += factor * np.cos(k * angle) * jump * np.cos(angle) / speed
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
