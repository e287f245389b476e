"""Filters and static curves on samples: response and tangents at the cost of a few filter passes.

Filters are written in δ = 1 − z⁻¹, H = (1 + n₁δ + n₂δ² + …)/(1 + d₁δ + d₂δ² + …): their static gain is 1, so no gain can
wander between the blocks, and the coefficients of slow poles are of one size. In powers of z⁻¹ the same descent needs ten
times the iterations.
"""

from __future__ import annotations

from collections.abc import Iterator
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

    def through(self, x: Floats) -> Floats:
        """Filter rows that have been at their first value for ever."""
        return filtered(self.num_z, self.den_z, x)

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
    """Filters and static curves one after the other: filter, curve, filter, or curve, filter, curve, or fewer.

    held: places in `values` that a fit leaves alone (what a gauge fixes).
    """

    parts: tuple[Filter | Static, ...]
    held: tuple[int, ...] = ()

    @property
    def values(self) -> Floats:
        """Return all numbers, part by part: a filter's n, d, a curve's in the order of its parameters."""
        return np.concatenate([np.concatenate(p) if isinstance(p, Filter) else _numbers(p) for p in self.parts])

    def places(self) -> Iterator[tuple[Filter | Static, slice]]:
        """Yield every part with where its numbers stand in `values`."""
        at = 0
        for part in self.parts:
            count = len(part.num) + len(part.den) if isinstance(part, Filter) else len(part.parameters())
            yield part, slice(at, at + count)
            at += count

    def replaced(self, values: Floats) -> Cascade:
        """Return the cascade with other numbers."""
        return self._replace(parts=tuple(_replaced(part, values[at]) for part, at in self.places()))

    @property
    def free(self) -> NDArray[np.bool_]:
        """Return which of the values a fit may change."""
        return ~np.isin(np.arange(len(self.values)), self.held)

    @property
    def stable(self) -> bool:
        """Tell whether all filters are."""
        return all(part.stable for part in self.parts if isinstance(part, Filter))

    @property
    def slowest(self) -> float:
        """Return the longest time constant of the filters, in samples."""
        radii = [float(np.abs(np.roots(p.den_z)).max(initial=0.0)) for p in self.parts if isinstance(p, Filter)]
        radius = max(radii, default=0.0)
        return -1 / float(np.log(radius)) if 0 < radius < 1 else (np.inf if radius else 0.0)

    @property
    def curves(self) -> tuple[Static, ...]:
        """Return the curves in order."""
        return tuple(part for part in self.parts if isinstance(part, Static))

    def arriving(self, u: Floats) -> Iterator[tuple[Filter | Static, Floats]]:
        """Yield every part with what arrives at it."""
        x = u
        for part in self.parts:
            yield part, x
            x = part.through(x) if isinstance(part, Filter) else part.value(x)

    def response(self, u: Floats) -> Floats:
        """Return the output, all filters steady at the first input."""
        x = u
        for part in self.parts:
            x = part.through(x) if isinstance(part, Filter) else part.value(x)
        return x

    def tangents(self, u: Floats) -> tuple[Floats, Floats]:
        """Return the output (N,) and its derivatives with respect to `values` (p, N).

        Those of the parts before go through the next: a filter filters them, a curve takes them by its slope. A part's own:
        ∂y/∂nₖ = δᵏu/D, ∂y/∂dₖ = −δᵏy/D of a filter, the sensitivities of a curve.
        """
        x, rows = u, np.empty((0, len(u)))
        for part in self.parts:
            if isinstance(part, Filter):
                y = part.through(x)
                rows = np.vstack([part.through(rows) if len(rows) else rows, _rates(part, x, y)])
            else:
                y, slope = _value_and_slope(part, x)
                rows = np.vstack([slope * rows, _sensitivities(part, x)])
            x = y
        return x, rows


def _numbers(curve: Static) -> list[float]:
    return [p.value for p in curve.parameters()]


def _replaced(part: Filter | Static, values: Floats) -> Filter | Static:
    if isinstance(part, Filter):
        return Filter(*np.split(values, [len(part.num)]))
    return part.with_parameters(dict(zip((p.name for p in part.parameters()), map(float, values), strict=True)))


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
