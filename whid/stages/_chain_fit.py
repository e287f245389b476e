"""Least squares of levels and harmonics together: f, front and back at once, each linear block in any parametrisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from whid.fit import DAMPING, Estimate, Parameter, least_squares
from whid.fit_many import Descents, descents
from whid.stages._inner_harmonics import inner_harmonics
from whid.stages._responses import Complexes, Floats, Responses, StaticPart
from whid.stages.identifiability import distinct, nearest

Ints = NDArray[np.intp]
STEP = 1e-5  # standard errors: a step below ends a fit; large levels over small errors leave χ² not much finer


class Response(Protocol):
    """A parametrisation of a linear block of unit static gain, at fixed frequencies."""

    @property
    def omega(self) -> Floats:
        """Return the frequencies."""

    def parameters(self) -> list[Parameter]:
        """Return the free numbers with their start values."""

    def __call__(self, theta: Floats) -> tuple[Complexes, Complexes]:
        """Return G (…, F) and ∂ log G/∂θ (…, F, p) of θ (…, p)."""


@dataclass(frozen=True, eq=False)
class FreeResponse:
    """Nonparametric: log gain and phase at every frequency."""

    omega: Floats
    start: Complexes
    block: str

    def parameters(self) -> list[Parameter]:
        """Return log gains, then phases."""
        gains, phases = np.log(np.abs(self.start)).tolist(), np.angle(self.start).tolist()
        return [
            *(Parameter(f"{self.block}.log_gain({w:.6g})", g) for w, g in zip(self.omega, gains, strict=True)),
            *(Parameter(f"{self.block}.phase({w:.6g})", p, "rad") for w, p in zip(self.omega, phases, strict=True)),
        ]

    def __call__(self, theta: Floats) -> tuple[Complexes, Complexes]:
        """Return exp(log gain + j·phase)."""
        n = len(self.omega)
        return np.exp(theta[..., :n] + 1j * theta[..., n:]), self._slopes

    @cached_property
    def _slopes(self) -> Complexes:
        return np.asarray(np.kron([1.0, 1j], np.eye(len(self.omega))), complex)


@dataclass(frozen=True, eq=False)
class RationalResponse:
    """(1 + b₁p + … + b_m p^m)/(1 + a₁p + … + a_n p^n) with p = jω/reference; numbers without unit."""

    omega: Floats
    numerator: Floats  # b₁ … b_m
    denominator: Floats  # a₁ … a_n
    reference: float
    block: str

    def parameters(self) -> list[Parameter]:
        """Return b₁ … b_m, a₁ … a_n; a stable denominator has positive coefficients."""
        tops = [Parameter(f"{self.block}.num.{k + 1}", float(b)) for k, b in enumerate(self.numerator)]
        return tops + [Parameter(f"{self.block}.den.{k + 1}", float(a), lower=0.0) for k, a in enumerate(self.denominator)]

    def __call__(self, theta: Floats) -> tuple[Complexes, Complexes]:
        """Return the response and its logarithmic derivatives."""
        m, (above, below) = len(self.numerator), self._powers
        top, bottom = 1 + theta[..., :m] @ above.T, 1 + theta[..., m:] @ below.T
        slopes = np.empty((*top.shape, theta.shape[-1]), complex)
        slopes[..., :m], slopes[..., m:] = above / top[..., None], -below / bottom[..., None]
        return top / bottom, slopes

    @cached_property
    def _powers(self) -> tuple[Complexes, Complexes]:
        """Return p … p^m and p … p^n, a row a frequency."""
        p: Complexes = np.asarray(1j * self.omega / self.reference, complex)[:, None]
        return p ** np.arange(1, len(self.numerator) + 1), p ** np.arange(1, len(self.denominator) + 1)


class _At(NamedTuple):
    """Where each of the D data stands in the arrays of inner harmonics, and each parameter of f in its own, flattened."""

    sine: Ints
    order: Ints
    turns: Complexes  # (D,) j·order
    turning: NDArray[np.bool_]  # (D,) has an imaginary part: all but the means
    turned: Ints  # which these are
    highest: int
    place: Ints  # (coefficients,) in (piece, power)
    datum: Ints  # (D,) in (sine, harmonic)
    coefficient: Ints  # (D, coefficients) in (sine, harmonic, piece, power)


@dataclass(frozen=True, eq=False)
class ChainFit:
    """Residuals and tangents of H_k = A_k(|x|)·e^{jk arg x}·G_back(jkω), x = phasor·G_front(jω), and of f at the levels.

    At a kink the pieces meet: the constant of its right piece follows from the rest, and its break is free, moved by the
    change of slope. With constants on both sides the break would have no effect to first order, and no end.
    """

    responses: Responses
    static: StaticPart
    front: Response
    back: Response
    free_breaks: tuple[int, ...] = ()

    def parameters(self) -> list[Parameter]:
        """Return f's coefficients, its free breaks, then the numbers of front and back."""
        s = self.static
        f = [
            Parameter(f"f.pieces.{p}.{k}", float(s.coefficients[p, k]), "output") for p, k in zip(*self._places, strict=True)
        ]
        f += [Parameter(f"f.breaks.{k}", float(s.breaks[k]), "input") for k in self._free]
        return f + self.front.parameters() + self.back.parameters()

    def solve(self, max_iterations: int = 60, start: Floats | None = None, damping: float = DAMPING) -> Estimate:
        """Fit everything at once, from all parameters as given or as declared; the weights are the measured errors."""
        cache: dict[bytes, tuple[Floats, Floats]] = {}

        def evaluated(free: Floats) -> tuple[Floats, Floats]:
            key = free.tobytes()
            if key not in cache:
                cache.clear()
                cache[key] = self.weighted(free)
            return cache[key]

        full = self.parameters()
        if start is not None:
            full = [p._replace(value=float(x)) for p, x in zip(full, start, strict=True)]
        found = least_squares(
            lambda free: evaluated(free)[0], lambda free: evaluated(free)[1], [full[k] for k in self._independent],
            np.ones(1), max_iterations=max_iterations, tolerance=STEP, damping=damping,
        )  # fmt: skip
        return self._whole(found)

    def race(self, starts: Floats, moving: NDArray[np.bool_], most: int) -> Descents:
        """Descend from many starts (B, P) side by side, the parameters that are not `moving` (B, P) held."""
        lower = np.array([p.lower for p in self.parameters()])[self._independent]
        ends = descents(self.weighted, starts[:, self._independent], moving[:, self._independent], lower, most)
        return ends._replace(theta=self.met(ends.theta)[0])

    def weighted(self, free: Floats) -> tuple[Floats, Floats]:
        """Return (residual (…, m), tangent (…, m, p)) of the independent parameters, in standard errors."""
        theta, change = self.met(free)
        residual, tangent = self.linearised(theta)
        if self.static.kinks:
            tangent = tangent @ change
        return residual * self._weights, tangent * self._weights[:, None]

    def met(self, free: Floats) -> tuple[Floats, Floats]:
        """Return all parameters (…, P) from the independent ones, and their derivative (…, P, independent)."""
        if not self.static.kinks:
            return free, self._spread
        batch = free.shape[:-1]
        theta = np.zeros((*batch, len(self._spread)))
        change = np.broadcast_to(self._spread, (*batch, *self._spread.shape)).copy()
        theta[..., self._independent] = free
        piece, power = self._places
        for k in self.static.kinks:
            at = len(piece) + self._free.index(k)
            left, right = np.flatnonzero(piece == k), np.flatnonzero(piece == k + 1)
            both, sign = np.append(left, right[1:]), np.append(np.ones(len(left)), -np.ones(len(right) - 1))
            b, n = theta[..., at, None], power[both]
            row, steep = sign * b**n, sign * n * b ** np.maximum(n - 1, 0)
            theta[..., right[0]] = (row * theta[..., both]).sum(axis=-1)
            slope = (steep * theta[..., both]).sum(axis=-1)[..., None]
            change[..., right[0], :] = (row[..., None, :] @ change[..., both, :])[..., 0, :] + slope * change[..., at, :]
        return theta, change

    def _whole(self, found: Estimate) -> Estimate:
        """Return the estimate of all parameters."""
        theta, change = self.met(found.values)
        covariance = change @ found.covariance @ change.T
        null = found.null_directions @ change.T
        endless = np.abs(null).max(axis=0, initial=0.0) > 1e-6
        return found._replace(
            names=tuple(p.name for p in self.parameters()), values=theta, covariance=covariance,
            std=np.where(endless, np.inf, np.sqrt(np.diag(covariance))), null_directions=null,
        )  # fmt: skip

    def linearised(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return (residual, tangent): levels first, then the harmonics, real parts and imaginary parts.

        θ (…, P) of all parameters; residual (…, m), tangent (…, m, P).
        """
        r, s, at = self.responses, self.static, self._at
        of_f, of_breaks, of_front, of_back = self._slices
        batch, n, m = theta.shape[:-1], len(s.level), len(at.turning)
        coefficients = np.zeros((*batch, s.coefficients.size))
        coefficients[..., at.place] = theta[..., of_f]
        breaks = s.breaks
        if self._free:
            breaks = np.broadcast_to(s.breaks, (*batch, len(s.breaks))).copy()
            breaks[..., list(self._free)] = theta[..., of_breaks]
        front, d_front = self.front(theta[..., of_front])
        back, d_back = self.back(theta[..., of_back])
        x = r.phasor * front.take(self._front_place, axis=-1)
        size = np.abs(x)
        inner = inner_harmonics(breaks, coefficients.reshape(*batch, *s.coefficients.shape), r.offset, size, at.highest)
        turn = (x / size).take(at.sine, axis=-1) ** at.order
        beyond = np.where(at.turning, back.take(self._back_place, axis=-1), 1.0) * turn
        value = inner.value.reshape(*batch, -1).take(at.datum, axis=-1)
        stretched = (size[..., None] * inner.by_amplitude).reshape(*batch, -1).take(at.datum, axis=-1)
        model = value * beyond
        of_data = np.empty((*batch, m, len(self._spread)), complex)
        by_coefficient = inner.by_coefficient.reshape(*batch, -1).take(at.coefficient, axis=-1)
        np.multiply(beyond[..., None], by_coefficient, out=of_data[..., of_f])
        if self._free:
            by_break = inner.by_break.reshape(*batch, -1, len(s.breaks)).take(at.datum, axis=-2)
            of_data[..., of_breaks] = beyond[..., None] * by_break.take(self._free, axis=-1)
        zeta = d_front.take(self._front_place[at.sine], axis=-2)
        of_front_data = of_data[..., of_front]
        np.multiply((beyond * stretched)[..., None], zeta.real, out=of_front_data)
        of_front_data += (at.turns * model)[..., None] * zeta.imag
        np.multiply((at.turning * model)[..., None], d_back.take(self._back_place, axis=-2), out=of_data[..., of_back])
        tangent = np.zeros((*batch, n + m + len(at.turned), len(self._spread)))
        tangent[..., :n, of_f] = self._level_rows(breaks)
        tangent[..., n : n + m, :], tangent[..., n + m :, :] = of_data.real, of_data.imag.take(at.turned, axis=-2)
        residual = np.empty(tangent.shape[:-1])
        gap = model - self._measured
        residual[..., :n] = (tangent[..., :n, of_f] @ theta[..., of_f, None])[..., 0] - s.mean
        residual[..., n : n + m], residual[..., n + m :] = gap.real, gap.imag.take(at.turned, axis=-1)
        return residual, tangent

    def _level_rows(self, breaks: Floats) -> Floats:
        """Return f at the levels, by its coefficients, (…, L, coefficients)."""
        if not self._free:
            return self._fixed_rows
        return self._rows(breaks)

    def _rows(self, breaks: Floats) -> Floats:
        piece = (breaks[..., None, :] <= self.static.level[:, None]).sum(axis=-1)
        powers = self.static.level[:, None] ** self._places[1]
        return np.where(piece[..., None] == self._places[0], powers, 0.0)

    @cached_property
    def _fixed_rows(self) -> Floats:
        return self._rows(self.static.breaks)

    @cached_property
    def _measured(self) -> Complexes:
        return np.asarray(self.responses.value[self._present])

    @cached_property
    def _at(self) -> _At:
        e, k = self._present
        highest, (pieces, size) = int(k.max()), self.static.coefficients.shape
        datum, place = e * (highest + 1) + k, self._places[0] * size + self._places[1]
        turning = k > 0
        return _At(
            e, k, np.asarray(1j * k, complex), turning, np.flatnonzero(turning), highest, place, datum,
            datum[:, None] * (pieces * size) + place,
        )  # fmt: skip

    @cached_property
    def _weights(self) -> Floats:
        std = self.responses.value_std[self._present]
        return np.asarray(1 / np.concatenate([self.static.mean_std, std, std[self._at.turning]]))

    @cached_property
    def _places(self) -> tuple[Ints, Ints]:
        """(piece, power) of every coefficient of f that is a parameter."""
        degrees = np.array(self.static.degrees)
        piece, power = np.nonzero(np.arange(self.static.coefficients.shape[1]) <= degrees[:, None])
        return piece, power

    @cached_property
    def _free(self) -> tuple[int, ...]:
        """Breaks that are parameters: those asked for, and every kink."""
        return tuple(sorted({*self.free_breaks, *self.static.kinks}))

    @cached_property
    def _independent(self) -> Ints:
        """Parameters but for the constants that the kinks make."""
        made = [int(np.flatnonzero(self._places[0] == k + 1)[0]) for k in self.static.kinks]
        return np.delete(np.arange(self._slices[-1].stop), made)

    @cached_property
    def _spread(self) -> Floats:
        """Derivative of all parameters with respect to the independent ones, but for what kinks make."""
        return np.eye(self._slices[-1].stop)[:, self._independent]

    @cached_property
    def _slices(self) -> tuple[slice, slice, slice, slice]:
        counts = (len(self._places[0]), len(self._free), len(self.front.parameters()), len(self.back.parameters()))
        ends = np.cumsum(counts)
        return tuple(slice(int(end) - n, int(end)) for end, n in zip(ends, counts, strict=True))  # type: ignore[return-value]

    @cached_property
    def _present(self) -> tuple[Ints, Ints]:
        """(sine, harmonic) of every datum."""
        pairs = np.array([(e, k) for e, ks in enumerate(self.responses.orders) for k in ks])
        return pairs[:, 0], pairs[:, 1]

    @cached_property
    def _front_place(self) -> Ints:
        return nearest(self.front.omega, self.responses.omega)

    @cached_property
    def _back_place(self) -> Ints:
        """Where each datum's kω stands among the frequencies of back; of the mean, whose gain is 1, anywhere."""
        sine, order = self._present
        return nearest(self.back.omega, order * self.responses.omega[sine])


def frequencies(responses: Responses) -> tuple[Floats, Floats]:
    """Return the distinct frequencies at which front and back are seen."""
    seen = [k * w for w, ks in zip(responses.omega, responses.orders, strict=True) for k in ks if k]
    return distinct(responses.omega), distinct(np.array(seen))
