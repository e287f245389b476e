"""Least squares of levels and harmonics together: f, front and back at once, each linear block in any parametrisation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from whid.fit import Estimate, Parameter, least_squares
from whid.stages._inner_harmonics import inner_harmonics
from whid.stages._responses import Complexes, Floats, Responses, StaticPart
from whid.stages.identifiability import distinct, nearest


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
        gains = [Parameter(f"{self.block}.log_gain({w:.6g})", np.log(abs(g))) for w, g in zip(self.omega, self.start, strict=True)]
        return gains + [
            Parameter(f"{self.block}.phase({w:.6g})", float(np.angle(g)), "rad") for w, g in zip(self.omega, self.start, strict=True)
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


class ChainFit(NamedTuple):
    """Residuals and tangents of H_k = A_k(|x|)·e^{jk arg x}·G_back(jkω), x = phasor·G_front(jω), and of f at the levels."""

    responses: Responses
    static: StaticPart
    front: Response
    back: Response
    free_breaks: tuple[int, ...] = ()

    def parameters(self) -> list[Parameter]:
        """Return f's coefficients, its free breaks, then the numbers of front and back."""
        s = self.static
        f = [
            Parameter(f"f.pieces.{piece}.{power}", float(s.coefficients[piece, power]), "output")
            for piece, degree in enumerate(s.degrees)
            for power in range(degree + 1)
        ]
        f += [Parameter(f"f.breaks.{k}", float(s.breaks[k]), "input") for k in self.free_breaks]
        return f + self.front.parameters() + self.back.parameters()

    def solve(self, max_iterations: int = 60) -> Estimate:
        """Fit everything at once; the weights are the measured standard errors."""
        weights = 1 / np.concatenate([self.static.mean_std, _stack_std(self.responses)])
        cache: dict[bytes, tuple[Floats, Floats]] = {}

        def evaluated(theta: Floats) -> tuple[Floats, Floats]:
            key = theta.tobytes()
            if key not in cache:
                cache.clear()
                cache[key] = self.linearised(theta)
            return cache[key]

        return least_squares(
            lambda t: evaluated(t)[0], lambda t: evaluated(t)[1], self.parameters(), weights, max_iterations=max_iterations
        )

    def linearised(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return (residual, tangent): levels first, then the harmonics, real parts and imaginary parts."""
        r, s = self.responses, self.static
        coefficients, breaks, sizes = self._static(theta)
        nf, nb = sizes
        front_count = len(self.front.parameters())
        front, d_front = self.front(theta[nf + nb : nf + nb + front_count])
        back, d_back = self.back(theta[nf + nb + front_count :])
        front_omega, back_omega = frequencies(r)
        design = self._level_design(breaks)
        f_levels = design @ theta[:nf]
        rows, tangents = [], []
        for e in range(len(r.omega)):
            place = nearest(front_omega, r.omega[e])
            x = r.phasor[e] * front[place]
            ks = np.array(r.orders[e])
            inner = inner_harmonics(breaks, coefficients, float(r.offset[e]), float(abs(x)), int(ks.max()))
            turn = np.exp(1j * ks * np.angle(x))
            which = [nearest(back_omega, k * r.omega[e]) if k else -1 for k in ks]
            g = np.array([1.0 if w < 0 else back[w] for w in which])
            a, da = inner.value[ks], inner.by_amplitude[ks]
            rows.append(a * turn * g - r.value[e, ks])
            block = np.zeros((len(ks), len(theta)), complex)
            block[:, :nf] = (turn * g)[:, None] * np.concatenate(
                [inner.by_coefficient[ks, p, : d + 1] for p, d in enumerate(s.degrees)], axis=1
            )
            block[:, nf : nf + nb] = (turn * g)[:, None] * inner.by_break[np.ix_(ks, self.free_breaks)] if nb else 0
            zeta = d_front[place]
            along = abs(x) * da[:, None] * zeta.real + 1j * (ks * a)[:, None] * zeta.imag
            block[:, nf + nb : nf + nb + front_count] = (turn * g)[:, None] * along
            for row, w in enumerate(which):
                if w >= 0:
                    block[row, nf + nb + front_count :] = (a * turn * g)[row] * d_back[w]
            tangents.append(block)
        level_rows = np.hstack([design, np.zeros((len(design), len(theta) - nf))])
        return (
            np.concatenate([f_levels - s.mean, *(_stack(row, r.orders[e]) for e, row in enumerate(rows))]),
            np.concatenate([level_rows, *(_stack(block, r.orders[e]) for e, block in enumerate(tangents))]),
        )

    def _static(self, theta: Floats) -> tuple[Floats, Floats, tuple[int, int]]:
        s = self.static
        coefficients, breaks = np.zeros_like(s.coefficients), s.breaks.copy()
        start = 0
        for piece, degree in enumerate(s.degrees):
            coefficients[piece, : degree + 1] = theta[start : start + degree + 1]
            start += degree + 1
        breaks[list(self.free_breaks)] = theta[start : start + len(self.free_breaks)]
        return coefficients, breaks, (start, len(self.free_breaks))

    def _level_design(self, breaks: Floats) -> Floats:
        s = self.static
        piece = np.searchsorted(breaks, s.level, side="right")
        columns = [np.where(piece == p, s.level**k, 0.0) for p, d in enumerate(s.degrees) for k in range(d + 1)]
        return np.array(columns).T.reshape(len(s.level), len(columns))


def frequencies(responses: Responses) -> tuple[Floats, Floats]:
    """Return the distinct frequencies at which front and back are seen."""
    seen = [k * w for w, ks in zip(responses.omega, responses.orders, strict=True) for k in ks if k]
    return distinct(responses.omega), distinct(np.array(seen))


def _stack(z: Complexes, orders: Sequence[int]) -> Floats:
    """Return real parts, then the imaginary parts of all but the mean."""
    imaginary = np.asarray(orders) > 0
    return np.concatenate([z.real, z.imag[imaginary]])


def _stack_std(responses: Responses) -> Floats:
    parts = []
    for e, ks in enumerate(responses.orders):
        std = responses.value_std[e, list(ks)]
        parts.append(np.concatenate([std, std[np.asarray(ks) > 0]]))
    return np.concatenate(parts)


