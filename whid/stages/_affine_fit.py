"""Least squares of levels and harmonics of a polynomial behind a linear block behind affine pieces, all at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from whid.fit import Estimate, Parameter, least_squares
from whid.signal import Floats

Complexes = NDArray[np.complex128]
Ints = NDArray[np.intp]


class Levels(NamedTuple):
    """Mean output at constant inputs, and the affine piece each lies on."""

    level: Floats  # (L,)
    mean: Floats
    std: Floats
    piece: Ints


class Tones(NamedTuple):
    """Harmonics 0 … n of the output under sines that stay on one affine piece each: u = offset + Re phasor e^{jωt}."""

    omega: Floats  # (E,) rad/s
    offset: Floats
    phasor: Complexes
    value: Complexes  # (E, n + 1)
    std: Floats  # (E, n + 1) of the real part, and of the imaginary part
    piece: Ints

    def of(self, which: NDArray[np.bool_]) -> Tones:
        """Return some of the sines."""
        return self._replace(**{name: each[which] for name, each in self._asdict().items()})


class Affine(NamedTuple):
    """One affine piece: x = value + slope·(u − centre)."""

    centre: float
    value: float
    slope: float
    flat: bool

    def __call__(self, u: Floats) -> Floats:
        """Return x."""
        return np.asarray(self.value + self.slope * (u - self.centre))

    def at(self, u: float) -> float:
        """Return x at one input."""
        return self.value + self.slope * (u - self.centre)


@dataclass(frozen=True, eq=False)
class AffineFit:
    """y = f(G·h(u)): f = Σ cᵢ xⁱ, G(0) = 1 and free at every frequency of the tones, h affine on every piece.

    The anchor has slope 1 and x = 0 at its centre: f is a Taylor series about the middle of its data. Residuals are those of
    the level means and of the complex harmonics, exact for a polynomial: f is sampled at 4n + 4 phases of a period.
    """

    levels: Levels
    tones: Tones
    coefficients: Floats  # (n + 1,) start of f
    pieces: Mapping[int, Affine]  # by number; those of the anchor and of every datum
    anchor: int
    gains: Mapping[float, complex] = field(default_factory=dict)  # start of G by ω

    @cached_property
    def omegas(self) -> Floats:
        """Return the distinct frequencies."""
        return np.unique(self.tones.omega)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return f.k, then h.<piece>.value and .slope, then g.<k>.log_gain and .phase."""
        names = [Parameter(f"f.{k}", float(c)) for k, c in enumerate(self.coefficients)]
        for number, piece in self._others:
            names.append(Parameter(f"h.{number}.value", piece.value))
            names += [] if piece.flat else [Parameter(f"h.{number}.slope", piece.slope)]
        for k, omega in enumerate(self.omegas):
            g = self.gains[float(omega)]
            names += [
                Parameter(f"g.{k}.log_gain", float(np.log(abs(g)))),
                Parameter(f"g.{k}.phase", float(np.angle(g)), "rad"),
            ]
        return tuple(names)

    def solve(self, max_iterations: int = 60) -> tuple[Estimate, AffineFit]:
        """Return the estimate, and the problem standing at it."""
        std = self.tones.std
        weights = 1 / np.concatenate([self.levels.std, std.ravel(), std[:, 1:].ravel()])
        cache: dict[bytes, tuple[Floats, Floats]] = {}

        def evaluated(theta: Floats) -> tuple[Floats, Floats]:
            key = theta.tobytes()
            if key not in cache:
                cache.clear()
                cache[key] = self.linearised(theta)
            return cache[key]

        with np.errstate(over="ignore", invalid="ignore"):
            found = least_squares(
                lambda t: evaluated(t)[0], lambda t: evaluated(t)[1], self.parameters, weights, max_iterations=max_iterations
            )
        return found, self.standing(found.values)

    def standing(self, theta: Floats) -> AffineFit:
        """Return the problem with other start values."""
        c, pieces, g = self._unpacked(theta)
        gains = {float(w): complex(r) for w, r in zip(self.omegas, g, strict=True)}
        return AffineFit(self.levels, self.tones, c, pieces, self.anchor, gains)

    @property
    def chi2(self) -> float:
        """Return χ² at the start values."""
        theta = np.array([p.value for p in self.parameters])
        std = self.tones.std
        with np.errstate(over="ignore", invalid="ignore"):
            r = self.linearised(theta)[0] / np.concatenate([self.levels.std, std.ravel(), std[:, 1:].ravel()])
        return float(r @ r)

    def linearised(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return residual and tangent: levels, then real parts of harmonics 0 … n, then imaginary parts of 1 … n."""
        c, pieces, g = self._unpacked(theta)
        levels, tones = self.levels, self.tones
        slope_of_f, powers = poly.polyder(c), np.arange(len(c))
        x = np.array([pieces[p].at(u) for p, u in zip(levels.piece, levels.level, strict=True)])
        by = np.zeros((len(x), len(theta)))
        by[:, : len(c)] = x[:, None] ** powers
        rate = poly.polyval(x, slope_of_f)
        for number, place, flat, piece in self._places(pieces):
            on = levels.piece == number
            by[on, place] = rate[on]
            if not flat:
                by[on, place + 1] = rate[on] * (levels.level[on] - piece.centre)
        residual = [poly.polyval(x, c) - levels.mean]
        if not len(tones.omega):
            return residual[0], by
        n, samples = tones.value.shape[1] - 1, 4 * len(c) + 4
        turn = np.exp(2j * np.pi * np.arange(samples) / samples)
        own = [pieces[p] for p in tones.piece]
        middle = np.array([p.at(v) for p, v in zip(own, tones.offset, strict=True)])
        driven = (tones.phasor * g[self._tone_omega])[:, None] * turn  # (E, samples), before the slope
        swing = np.array([p.slope for p in own])[:, None] * driven
        inner = middle[:, None] + swing.real
        rate = poly.polyval(inner, slope_of_f)
        dinner = np.zeros((len(theta), *inner.shape))
        for number, place, flat, piece in self._places(pieces):
            on = tones.piece == number
            dinner[place, on] = rate[on]
            if not flat:
                dinner[place + 1, on] = rate[on] * (driven[on].real + (tones.offset[on] - piece.centre)[:, None])
        first = len(theta) - 2 * len(self.omegas)
        for e, k in enumerate(self._tone_omega):
            dinner[first + 2 * k, e] = rate[e] * swing[e].real
            dinner[first + 2 * k + 1, e] = rate[e] * -swing[e].imag
        for k in powers:
            dinner[k] = inner**k
        gap = _harmonics(poly.polyval(inner, c), n) - tones.value
        tangent = _harmonics(dinner, n)
        flat_gap, flat_tangent = gap.reshape(-1), tangent.reshape(len(theta), -1).T
        turning = np.tile(np.arange(n + 1) > 0, len(tones.omega))
        return (
            np.concatenate([*residual, flat_gap.real, flat_gap.imag[turning]]),
            np.concatenate([by, flat_tangent.real, flat_tangent.imag[turning]]),
        )

    @property
    def _others(self) -> list[tuple[int, Affine]]:
        return [(number, piece) for number, piece in sorted(self.pieces.items()) if number != self.anchor]

    @cached_property
    def _tone_omega(self) -> Ints:
        return np.searchsorted(self.omegas, self.tones.omega)

    def _places(self, pieces: Mapping[int, Affine]) -> Sequence[tuple[int, int, bool, Affine]]:
        """Return (piece, place of its value among the parameters, flat, the piece) of all but the anchor."""
        found, place = [], len(self.coefficients)
        for number, piece in self._others:
            found.append((number, place, piece.flat, pieces[number]))
            place += 1 if piece.flat else 2
        return found

    def _unpacked(self, theta: Floats) -> tuple[Floats, dict[int, Affine], Complexes]:
        c, pieces = theta[: len(self.coefficients)], dict(self.pieces)
        for number, place, flat, piece in self._places(self.pieces):
            slope = 0.0 if flat else float(theta[place + 1])
            pieces[number] = piece._replace(value=float(theta[place]), slope=slope)
        g = theta[len(theta) - 2 * len(self.omegas) :].reshape(-1, 2)
        return c, pieces, np.exp(g[:, 0] + 1j * g[:, 1])


def real_roots(coefficients: NDArray[Any]) -> Floats:
    """Return the real roots of a polynomial, ascending.

    >>> real_roots(np.array([-2.0, 1.0, -2.0, 1.0]))  # (x − 2)(x² + 1)
    array([2.])
    """
    roots = np.atleast_1d(poly.polyroots(poly.polytrim(coefficients)))
    return np.sort(roots[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))].real)


def shifted(coefficients: Floats, by: float) -> Floats:
    """Return the coefficients of f(x + by).

    >>> shifted(np.array([0.0, 0.0, 1.0]), 2.0)
    array([4., 4., 1.])
    """
    found = np.zeros(1)
    for c in coefficients[::-1]:
        found = poly.polyadd(poly.polymul(found, [by, 1.0]), [c])
    return np.pad(found, (0, len(coefficients)))[: len(coefficients)]


def _harmonics(period: Floats, highest: int) -> Complexes:
    """Return harmonics 0 … highest of periods sampled along the last axis."""
    spectrum = np.fft.rfft(period)[..., : highest + 1] * 2 / period.shape[-1]
    spectrum[..., 0] /= 2
    return np.asarray(spectrum)
