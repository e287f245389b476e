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

    value: Floats  # (…, E, K + 1)
    by_amplitude: Floats  # (…, E, K + 1)
    by_coefficient: Floats  # (…, E, K + 1, S + 1, d + 1)
    by_break: Floats  # (…, E, K + 1, S)


@lru_cache
def _nodes(count: int) -> tuple[Floats, Floats]:
    x, w = leggauss(count)
    return (x + 1) / 2, w / 2


@lru_cache
def _factor(highest: int) -> tuple[NDArray[np.intp], Floats]:
    """Return k = 0 … highest and what stands before the integral of A_k."""
    k = np.arange(highest + 1)
    return k, np.where(k == 0, 1.0, 2.0) / np.pi


def inner_harmonics(breaks: Floats, coefficients: Floats, offset: Floats, amplitude: Floats, highest: int) -> InnerHarmonics:
    """Return A_k = (2/π) ∫₀^π f(offset + amplitude·cos θ) cos kθ dθ (half of it for k = 0), k = 0 … highest.

    breaks (S,) ascending, coefficients (S + 1, d + 1) ascending powers of v, zero-padded, offset (E,), amplitude (E,) > 0;
    breaks, coefficients and amplitude may have further axes in front: as many curves side by side, the result has them too.
    From θ = 0 down the sine passes the pieces from the last to the first; each arc (empty where a break is out of reach) is
    integrated by enough Gauss-Legendre nodes to be exact to rounding.
    Source [Brouri2019], eqs. (3.21)-(3.23); [PAPERS A, build 6].

    >>> square = np.array([[0.0, 0.0, 1.0]])
    >>> inner_harmonics(np.empty(0), square, np.array([2.0]), np.array([1.0]), 2).value.round(12)  # (2 + cos θ)²
    array([[4.5, 4. , 0.5]])
    """
    pieces, size = coefficients.shape[-2:]
    if pieces > 1:
        edges = np.zeros((*amplitude.shape, pieces + 1))
        level = (breaks[..., None, ::-1] - offset[:, None]) / amplitude[..., None]
        edges[..., 1:-1], edges[..., -1] = np.arccos(np.clip(level, -1, 1)), np.pi
        cos, cosines = _arcs(edges, highest, size)
    else:
        cos, cosines = _whole(highest, size)
    powers = _powers(offset[:, None, None] + amplitude[..., None, None] * cos, size)
    own = coefficients[..., None, ::-1, :]
    slope = powers[..., :-1] @ (own[..., 1:] * np.arange(1, size))[..., None]
    by_coefficient = cosines @ powers
    value = (by_coefficient @ own[..., None])[..., 0].sum(axis=-2)
    by_amplitude = (cosines @ (slope * cos[..., None]))[..., 0].sum(axis=-2)
    by_break, (k, factor) = np.zeros((*value.shape, pieces - 1)), _factor(highest)
    for j in range(pieces - 1):
        b, apart = breaks[..., j, None], coefficients[..., j + 1, :] - coefficients[..., j, :]
        jump = (_powers(b, size) * apart[..., None, :]).sum(axis=-1)
        inside = np.abs(b - offset) < amplitude
        ratio = np.where(inside, (b - offset) / amplitude, 0.0)
        # above the break (θ < angle) f is the upper piece: A = ∫₀^angle upper + ∫_angle^π lower
        height = np.where(inside, jump / (amplitude * np.sqrt(1 - ratio**2)), 0.0)
        moved = factor * np.cos(k * np.arccos(ratio)[..., None]) * height[..., None]
        by_break[..., j] = -moved
        by_amplitude += moved * ratio[..., None]
    return InnerHarmonics(value, by_amplitude, np.swapaxes(by_coefficient, -3, -2)[..., ::-1, :], by_break)


def _arcs(edges: Floats, highest: int, size: int) -> tuple[Floats, Floats]:
    """Return cos θ at the nodes of every arc between edges (…, A + 1), (…, A, nodes), and the weights of ∫ · cos kθ dθ.

    Weights (…, A, K + 1, nodes), those of A_k: with its factor.
    """
    x, w = _nodes(14 + (highest + size) * 3 // 2)
    width = np.diff(edges)[..., None]
    cos = np.cos(edges[..., :-1, None] + width * x)
    return cos, _cosines(cos, highest) * (width * w)[..., None, :] * _factor(highest)[1][:, None]


@lru_cache
def _whole(highest: int, size: int) -> tuple[Floats, Floats]:
    """Return the same of one piece, whose arc is the same for all sines."""
    return _arcs(np.array([[0.0, np.pi]]), highest, size)


def _powers(v: Floats, count: int) -> Floats:
    """Return 1, v, v², … along a last axis."""
    found = np.ones((*v.shape, count))
    for p in range(1, count):
        np.multiply(found[..., p - 1], v, out=found[..., p])
    return found


def _cosines(cos: Floats, highest: int) -> Floats:
    """Return cos kθ, k = 0 … highest, along the last axis but one, by cos kθ = 2 cos θ cos (k − 1)θ − cos (k − 2)θ."""
    found = np.ones((*cos.shape[:-1], highest + 1, cos.shape[-1]))
    if highest:
        found[..., 1, :] = cos
    for k in range(2, highest + 1):
        found[..., k, :] = 2 * cos * found[..., k - 1, :] - found[..., k - 2, :]
    return found


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
