"""Chebyshev polynomials on data: basis, nodes, the transform from values at nodes, moments that stream."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from whid.signal import Floats

Domain = tuple[float, float]
CHUNK = 1 << 15  # samples: what is made of a chunk costs more than the calls that make it, and stays in the cache


def scaled(x: Floats, domain: Domain) -> Floats:
    """Return t = (2x − a − b)/(b − a)."""
    a, b = domain
    return np.asarray(x if (a, b) == (-1.0, 1.0) else (x - (a + b) / 2) / ((b - a) / 2))


def unscaled(t: Floats, domain: Domain) -> Floats:
    """Return x of t."""
    a, b = domain
    return np.asarray((a + b) / 2 + t * ((b - a) / 2))


def basis(t: Floats, order: int, out: Floats | None = None) -> Floats:
    """Return T₀(t) … T_K(t), (K + 1, N), by the recursion (4)-(6); out: where they go.

    >>> basis(np.array([0.5]), 3)[:, 0]
    array([ 1. ,  0.5, -0.5, -1. ])
    """
    rows = np.empty((order + 1, len(t))) if out is None else out
    rows[0] = 1.0
    if order:
        rows[1] = t
    twice = 2 * t
    for j in range(1, order):
        np.multiply(twice, rows[j], out=rows[j + 1])
        rows[j + 1] -= rows[j - 1]
    return rows


@lru_cache
def nodes(order: int) -> Floats:
    """Return tᵢ = cos((2i + 1)π/(2K + 2)), i = 0 … K, descending: eq. (2)."""
    found = np.cos((2 * np.arange(order + 1) + 1) * np.pi / (2 * order + 2))
    found.flags.writeable = False
    return found


@lru_cache
def transform(order: int) -> Floats:
    """Return D (K + 1, K + 1): coefficients = D @ values at the nodes, eq. (7) and (8).

    >>> bool(np.allclose(transform(7) @ basis(nodes(7), 7).T, np.eye(8)))
    True
    """
    found = basis(nodes(order), order) * 2 / (order + 1)
    found[0] /= 2
    found.flags.writeable = False
    return found


class Moments(NamedTuple):
    """All that least squares needs of a record: 3M + 5 sums, however many samples."""

    sums: Floats  # (2M + 1,) Σ T_m(t)
    products: Floats  # (M + 1,) Σ y·T_j(t)
    square: float  # Σ y²
    samples: int

    def joined(self, other: Moments) -> Moments:
        """Return the moments of both stretches together."""
        sums, products = self.sums + other.sums, self.products + other.products
        return Moments(sums, products, self.square + other.square, self.samples + other.samples)

    def gram(self, order: int) -> Floats:
        """Return Σ T_j T_k = (S_{j+k} + S_{|j−k|})/2 up to an order."""
        j = np.arange(order + 1)
        return np.asarray((self.sums[j[:, None] + j] + self.sums[np.abs(j[:, None] - j)]) / 2)


def empty(order: int) -> Moments:
    """Return the moments of no samples."""
    return Moments(np.zeros(2 * order + 1), np.zeros(order + 1), 0.0, 0)


def moments(t: Floats, y: Floats, order: int, made: Floats | None = None) -> Moments:
    """Return the moments up to an order M of samples t, y (N,), chunk by chunk; made: T₀ … T_M of t where they are known.

    Only T₀ … T_M are made: Σ T_{M+j} = 2 Σ T_M T_j − Σ T_{M−j}.

    >>> t = np.linspace(-1, 1, 9000)
    >>> bool(np.allclose(moments(t, t, 4).gram(4), basis(t, 4) @ basis(t, 4).T))
    True
    """
    total = empty(order)
    for start in range(0, len(t), CHUNK):
        part = slice(start, start + CHUNK)
        rows = basis(t[part], order) if made is None else made[:, part]
        low = rows @ np.ones(len(rows[0]))
        high = 2 * (rows @ rows[order]) - low[::-1]
        sums = np.concatenate([low, high[1:]])
        total = total.joined(Moments(sums, rows @ y[part], float(y[part] @ y[part]), len(rows[0])))
    return total


def evaluate(t: Floats, coefficients: Floats) -> Floats:
    """Return Σ cₖ Tₖ(t)."""
    return np.asarray(np.polynomial.chebyshev.chebval(t, coefficients))
