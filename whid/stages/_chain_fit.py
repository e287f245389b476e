"""Least squares of levels and harmonics together: f, front and back at once, each linear block in any parametrisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from whid.fit import Estimate, Parameter, least_squares
from whid.stages._inner_harmonics import inner_harmonics
from whid.stages._responses import Complexes, Floats, Responses, StaticPart
from whid.stages.identifiability import distinct, nearest

Ints = NDArray[np.intp]


class Response(Protocol):
    """A parametrisation of a linear block of unit static gain, at fixed frequencies."""

    def parameters(self) -> list[Parameter]:
        """Return the free numbers with their start values."""

    def __call__(self, theta: Floats) -> tuple[Complexes, Complexes]:
        """Return G (F,) and ∂ log G/∂θ (F, p)."""


class FreeResponse(NamedTuple):
    """Nonparametric: log gain and phase at every frequency."""

    omega: Floats
    start: Complexes
    block: str

    def parameters(self) -> list[Parameter]:
        """Return log gains, then phases."""
        gains = [
            Parameter(f"{self.block}.log_gain({w:.6g})", np.log(abs(g))) for w, g in zip(self.omega, self.start, strict=True)
        ]
        return gains + [
            Parameter(f"{self.block}.phase({w:.6g})", float(np.angle(g)), "rad")
            for w, g in zip(self.omega, self.start, strict=True)
        ]

    def __call__(self, theta: Floats) -> tuple[Complexes, Complexes]:
        """Return exp(log gain + j·phase)."""
        n = len(self.omega)
        return np.exp(theta[:n] + 1j * theta[n:]), np.hstack([np.eye(n), 1j * np.eye(n)]).astype(complex)


class RationalResponse(NamedTuple):
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
        m, n = len(self.numerator), len(self.denominator)
        p = 1j * self.omega / self.reference
        powers = p[:, None] ** np.arange(1, max(m, n) + 1)
        top, bottom = 1 + powers[:, :m] @ theta[:m], 1 + powers[:, :n] @ theta[m:]
        return top / bottom, np.hstack([powers[:, :m] / top[:, None], -powers[:, :n] / bottom[:, None]])


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

    def solve(self, max_iterations: int = 60) -> Estimate:
        """Fit everything at once; the weights are the measured standard errors."""
        std = self.responses.value_std[self._present]
        weights = 1 / np.concatenate([self.static.mean_std, std, std[self._turning]])
        cache: dict[bytes, tuple[Floats, Floats]] = {}

        def evaluated(theta: Floats) -> tuple[Floats, Floats]:
            key = theta.tobytes()
            if key not in cache:
                cache.clear()
                cache[key] = self.linearised(theta)
            return cache[key]

        def tangent(free: Floats) -> Floats:
            theta, change = self.met(free)
            return evaluated(theta)[1] @ change if self.static.kinks else evaluated(theta)[1]

        full = self.parameters()
        found = least_squares(
            lambda free: evaluated(self.met(free)[0])[0], tangent, [full[k] for k in self._independent], weights,
            max_iterations=max_iterations,
        )  # fmt: skip
        return self._whole(found)

    def met(self, free: Floats) -> tuple[Floats, Floats]:
        """Return all parameters (P,) from the independent ones, and their derivative (P, independent)."""
        if not self.static.kinks:
            return free, self._spread
        theta, change = np.zeros(len(self._spread)), self._spread.copy()
        theta[self._independent] = free
        piece, power = self._places
        for k in self.static.kinks:
            at = len(piece) + self._free.index(k)
            left, right = np.flatnonzero(piece == k), np.flatnonzero(piece == k + 1)
            both, sign = np.append(left, right[1:]), np.append(np.ones(len(left)), -np.ones(len(right) - 1))
            b, n = theta[at], power[both]
            row = sign * b**n
            slope = float((sign * n * b ** np.maximum(n - 1, 0)) @ theta[both])
            theta[right[0]] = row @ theta[both]
            change[right[0]] = row @ change[both] + slope * change[at]
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
        """Return (residual, tangent): levels first, then the harmonics, real parts and imaginary parts."""
        r, s, (e, k) = self.responses, self.static, self._present
        of_f, of_breaks, of_front, of_back = self._slices
        coefficients, breaks = np.zeros_like(s.coefficients), s.breaks.copy()
        coefficients[self._places] = theta[of_f]
        breaks[list(self._free)] = theta[of_breaks]
        front, d_front = self.front(theta[of_front])
        back, d_back = self.back(theta[of_back])
        x = r.phasor * front[self._front_place]
        inner = inner_harmonics(breaks, coefficients, r.offset, np.abs(x), int(k.max()))
        place = self._back_place
        beyond = np.where(place < 0, 1.0, back[place]) * np.exp(1j * k * np.angle(x)[e])
        tangent = np.zeros((len(e), len(theta)), complex)
        tangent[:, of_f] = beyond[:, None] * inner.by_coefficient[e, k][:, *self._places]
        tangent[:, of_breaks] = beyond[:, None] * inner.by_break[e, k][:, list(self._free)]
        zeta = d_front[self._front_place][e]
        tangent[:, of_front] = beyond[:, None] * (
            (np.abs(x)[e] * inner.by_amplitude[e, k])[:, None] * zeta.real
            + 1j * (k * inner.value[e, k])[:, None] * zeta.imag
        )
        model = inner.value[e, k] * beyond
        tangent[:, of_back] = np.where(place < 0, 0.0, model)[:, None] * d_back[place]
        piece = np.searchsorted(breaks, s.level, side="right")
        levels = np.zeros((len(s.level), len(theta)))
        levels[:, of_f] = np.where(piece[:, None] == self._places[0], s.level[:, None] ** self._places[1], 0.0)
        gap, turning = model - r.value[e, k], self._turning
        return (
            np.concatenate([levels[:, of_f] @ theta[of_f] - s.mean, gap.real, gap.imag[turning]]),
            np.concatenate([levels, tangent.real, tangent.imag[turning]]),
        )

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
        return np.setdiff1d(np.arange(len(self.parameters())), made)

    @cached_property
    def _spread(self) -> Floats:
        """Derivative of all parameters with respect to the independent ones, but for what kinks make."""
        return np.eye(len(self.parameters()))[:, self._independent]

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
    def _turning(self) -> NDArray[np.bool_]:
        """Which data have an imaginary part: all but the means."""
        return np.asarray(self._present[1] > 0)

    @cached_property
    def _front_place(self) -> Ints:
        omegas = frequencies(self.responses)[0]
        return np.array([nearest(omegas, w) for w in self.responses.omega])

    @cached_property
    def _back_place(self) -> Ints:
        """Where each datum's kω stands among the frequencies of back; −1 for the mean, whose gain is 1."""
        omegas = frequencies(self.responses)[1]
        return np.array(
            [nearest(omegas, k * self.responses.omega[e]) if k else -1 for e, k in zip(*self._present, strict=True)]
        )


def frequencies(responses: Responses) -> tuple[Floats, Floats]:
    """Return the distinct frequencies at which front and back are seen."""
    seen = [k * w for w, ks in zip(responses.omega, responses.orders, strict=True) for k in ks if k]
    return distinct(responses.omega), distinct(np.array(seen))
