"""Filter, static curve, filter on samples: response and tangents at the cost of a few filter passes.

Filters are written in δ = 1 − z⁻¹, H = (1 + n₁δ + n₂δ² + …)/(1 + d₁δ + d₂δ² + …): their static gain is 1, so no gain can
wander between the blocks, and the coefficients of slow poles are of one size. In powers of z⁻¹ the same descent needs ten
times the iterations.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.blocks._static import Static
from whid.blocks.linear import Linear
from whid.blocks.spline import Spline
from whid.signal import Floats


def from_delta(coefficients: NDArray[Any]) -> NDArray[Any]:
    """Return Σ cₖδᵏ in powers of z⁻¹, ascending; 1 − x is its own inverse, so the way back as well.

    >>> from_delta(np.array([1.0, 2.0, 1.0]))
    array([ 4., -4.,  1.])
    """
    out, power = np.zeros(len(coefficients), np.asarray(coefficients).dtype), np.ones(1)
    for c in coefficients:
        out[: len(power)] += c * power
        power = np.convolve(power, [1.0, -1.0])
    return out


class Filter(NamedTuple):
    """A discrete filter of unit static gain: n₁ … and d₁ … ."""

    num: Floats
    den: Floats

    @classmethod
    def of_roots(cls, zeros: NDArray[Any], poles: NDArray[Any]) -> Filter:
        """Return the filter of zeros and poles (z), each set closed under conjugation; infinite without static gain."""
        num, den = (from_delta(np.real(np.atleast_1d(np.poly(roots)))) for roots in (zeros, poles))
        with np.errstate(divide="ignore", invalid="ignore"):
            return cls(num[1:] / num[0], den[1:] / den[0])

    @property
    def num_z(self) -> Floats:
        """Return the numerator in powers of z⁻¹."""
        return from_delta(np.append(1.0, self.num))

    @property
    def den_z(self) -> Floats:
        """Return the denominator in powers of z⁻¹."""
        return from_delta(np.append(1.0, self.den))

    @property
    def stable(self) -> bool:
        """Tell whether all poles lie inside the unit circle."""
        return bool(np.all(np.abs(np.roots(self.den_z)) < 1 - 1e-9))

    def at(self, omega_dt: Floats) -> NDArray[np.complex128]:
        """Return the response at frequencies times the sampling time."""
        back = np.exp(-1j * omega_dt)
        return np.asarray(np.polyval(self.num_z[::-1], back) / np.polyval(self.den_z[::-1], back))

    def padded(self, zeros: int) -> Filter:
        """Return the same filter with room for more zeros."""
        return self._replace(num=np.append(self.num, np.zeros(max(0, zeros - len(self.num)))))

    def block(self, dt: float) -> Linear:
        """Return the block: num and den of one length, den[0] = 1."""
        num, den = _monic(self)
        return Linear(num=tuple(map(float, num)), den=tuple(map(float, den)), dt=dt)


class Cascade(NamedTuple):
    """Filter, static curve, filter."""

    front: Filter
    curve: Static
    back: Filter

    @property
    def values(self) -> Floats:
        """Return all numbers: front's n, d, the curve's in the order of its parameters, back's n, d."""
        return np.concatenate([*self.front, [p.value for p in self.curve.parameters()], *self.back])

    def replaced(self, values: Floats) -> Cascade:
        """Return the cascade with other numbers."""
        names = [p.name for p in self.curve.parameters()]
        sizes = [len(self.front.num), len(self.front.den), len(names), len(self.back.num)]
        a, b, c, d, e = np.split(values, np.cumsum(sizes))
        curve = self.curve.with_parameters(dict(zip(names, map(float, c), strict=True)))
        return Cascade(Filter(a, b), curve, Filter(d, e))

    @property
    def stable(self) -> bool:
        """Tell whether both filters are."""
        return self.front.stable and self.back.stable

    def inner(self, u: Floats) -> Floats:
        """Return what arrives at the curve."""
        return filtered(self.front.num_z, self.front.den_z, u)

    def response(self, u: Floats) -> Floats:
        """Return the output, both filters steady at the first input."""
        return filtered(self.back.num_z, self.back.den_z, self.curve.value(self.inner(u)))

    def tangents(self, u: Floats) -> tuple[Floats, Floats]:
        """Return the output (N,) and its derivatives with respect to `values` (p, N).

        ∂v/∂nₖ = δᵏu/D, ∂v/∂dₖ = −δᵏv/D; then through f′ and back; back's own likewise from w and y.
        """
        one = np.ones(1)
        v = self.inner(u)
        front = _rates(self.front, u, v)
        w, slope = _value_and_slope(self.curve, v)
        rows = np.vstack([slope * front, _sensitivities(self.curve, v)])
        num, den = self.back.num_z, self.back.den_z
        y = filtered(num, den, w)
        through = filtered(num, den, rows) if len(num) + len(den) > 2 else rows * (num / den * one)
        return y, np.vstack([through, _rates(self.back, w, y)])


def _rates(h: Filter, u: Floats, y: Floats) -> Floats:
    """Return ∂y/∂n₁ … and ∂y/∂d₁ … (p, N)."""
    rows = []
    for source, count, sign in ((u, len(h.num), 1.0), (y, len(h.den), -1.0)):
        x = filtered(np.ones(1), h.den_z, source) if count else source
        for _ in range(count):
            x = np.diff(x, prepend=x[:1])
            rows.append(sign * x)
    return np.array(rows).reshape(len(rows), len(u))


def filtered(num: Floats, den: Floats, x: Floats) -> Floats:
    """Filter rows that have been at their first value for ever."""
    from scipy.signal import lfilter, lfilter_zi

    if max(len(num), len(den)) < 2:
        return np.asarray(num[0] / den[0] * x)
    zi = lfilter_zi(num, den)
    return np.asarray(lfilter(num, den, x, zi=zi * x[..., :1])[0])


def _value_and_slope(curve: Static, v: Floats) -> tuple[Floats, Floats]:
    return curve.value_and_slope(v) if isinstance(curve, Spline) else (curve.value(v), curve.derivative(v))


def _sensitivities(curve: Static, v: Floats) -> Floats:
    if isinstance(curve, Spline):
        return np.ascontiguousarray(curve.basis(v).T)
    return np.array([curve.sensitivity(v, p.name) for p in curve.parameters()]).reshape(-1, len(v))


def _monic(h: Filter) -> tuple[Floats, Floats]:
    num, den = h.num_z, h.den_z
    length = max(len(num), len(den))
    return np.append(num, np.zeros(length - len(num))) / den[0], np.append(den, np.zeros(length - len(den))) / den[0]


def monic_rates(h: Filter) -> Floats:
    """Return the derivatives of `block`'s num, then den, with respect to n₁ …, d₁ … ."""
    own, step = np.concatenate(h), 1e-30
    columns = []
    for k in range(len(own)):
        moved = own.astype(complex)
        moved[k] += 1j * step
        a, b = np.split(moved, [len(h.num)])
        num, den = _monic(Filter(a, b))
        columns.append(np.concatenate([num.imag, den.imag]) / step)
    return np.array(columns).reshape(len(own), -1).T
