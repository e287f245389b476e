"""What the exhibits of [Brouri2014] share: sines on a plant, and the paper's progressive search for the pieces."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.polynomial import polynomial as poly

from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.fit import Parameter, least_squares
from whid.quantity import Measured
from whid.signal import Floats
from whid.simulate import simulate
from whid.stages._affine_fit import real_roots
from whid.stages._inner_harmonics import held_sine
from whid.stages.constant_test import constant_test
from whid.stages.periods import Harmonics, harmonics
from whid.stages.static_test import StaticTest, static_test
from whid.system import System

OWN_PLANT = (
    "The paper gives no numbers and its figures are lost: plant, noise and sines are our own, nothing can be compared."
)
SAMPLES, PERIODS, LEAD = 200, 20, 3  # of a sine
STEP = 0.02  # of the amplitude, from one experiment to the next
SURE = 1e-4  # p below which a curve is not static, or not constant: at .01 one experiment in a hundred is a false border


class Shot(NamedTuple):
    """One sine experiment and what its tests say."""

    offset: float
    amplitude: float
    harmonics: Harmonics
    constant: bool
    static: StaticTest


class Segment(NamedTuple):
    """A piece as the progressive search leaves it: where it begins, the end it found, its last experiment inside."""

    start: float
    end: float
    last: Shot

    @property
    def flat(self) -> bool:
        """Tell whether the output was constant on it."""
        return self.last.constant


def shoot(plant: System, offset: float, amplitude: float, omega: float, degree: int, rng: np.random.Generator) -> Shot:
    """Return one experiment: 3 lead periods, then 20 of 200 samples."""
    dt = 2 * np.pi / (omega * SAMPLES)
    part = Sine(offset=offset, amplitude=amplitude, period=float(SAMPLES), periods=PERIODS, lead_periods=LEAD)
    record = simulate(plant, Experiment(dt=dt, parts=(part,)), rng)
    found = harmonics(record.y, SAMPLES, LEAD)
    drive = held_sine(amplitude, 0.0, omega, dt, "zoh")
    test = static_test(found, degree, drive, significance=SURE)
    return Shot(offset, abs(drive), found, constant_test(found, significance=SURE).constant, test)


def progressive(
    plant: System, low: float, high: float, omega: float, degree: int, rng: np.random.Generator
) -> tuple[list[Segment], int]:
    """Return the pieces and the number of experiments of the paper's search, eqs. (13), (24), (29).

    u = d + ε(1 + sin ωt) from the last border on, ε growing until the output is not constant any more, on a flat piece, or
    its curve not static: the border is then called d + 2ε.
    """
    segments: list[Segment] = []
    start, epsilon, count = low, STEP, 0
    last: Shot | None = None
    while start + 2 * epsilon < high + STEP:
        shot = shoot(plant, start + epsilon, epsilon, omega, degree, rng)
        count += 1
        if last is None or (shot.constant if last.constant else shot.static.static):
            last, epsilon = shot, epsilon + STEP
            continue
        segments.append(Segment(start, start + 2 * epsilon, last))
        start, epsilon, last = start + 2 * epsilon, STEP, None
    return ([*segments, Segment(start, high, last)] if last else segments), count


def curve_of(shot: Shot) -> Floats:
    """Return the static curve as a polynomial of the sine about its middle."""
    c = np.asarray(chebyshev.cheb2poly(shot.static.along), float)
    size = len(shot.static.along)
    return np.asarray(np.pad(c, (0, size - len(c))) / shot.amplitude ** np.arange(size))


def stretch(anchor: Shot, other: Shot) -> Measured:
    """Return the slope of another piece over the anchor's: how much its curve is stretched, by least squares.

    min Σ (harmonics of f(p + s·z) − along)²/std² over p and s, f the anchor's curve, both signs of s and 5 sizes as starts.
    (28a), corrected: it takes the slope from crossings of the axis, which move by −G(0)/|G| a unit of V on every piece.
    """
    f, z = curve_of(anchor), other.amplitude * np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    along = other.static.along
    rows = np.cos(np.outer(np.arange(len(along)), np.arccos(z / other.amplitude))) / 32
    rows[0] /= 2

    def residual(x: Floats) -> Floats:
        return np.asarray(rows @ np.asarray(poly.polyval(x[0] + x[1] * z, f)) - along)

    def tangent(x: Floats) -> Floats:
        rate = np.asarray(poly.polyval(x[0] + x[1] * z, poly.polyder(f)))
        return np.column_stack([rows @ rate, rows @ (rate * z)])

    # a curve taken in the other direction has its phase half a turn off: the slope's sign is in the phase
    facing = np.cos(other.static.phase - anchor.static.phase) > 0
    roots = real_roots(poly.polysub(f, [along[0]]))
    starts = [(p, s) for p in (*roots, 0.0) for s in (0.2, 0.5, 1.0, 2.0, 4.0)]
    ends = [
        least_squares(residual, tangent, [Parameter("p", float(p)), Parameter("s", s)], 1 / other.static.along_std)
        for p, s in starts
    ]
    best = min(ends, key=lambda e: e.chi2)
    return Measured(float(best.values[1]) * (1 if facing else -1), float(best.std[1]))


def crossing_rate(plant: System, low: float, high: float, omega: float, degree: int) -> float | None:
    """Return how far the curve's zero moves a unit of V on a piece, without noise, eq. (27a); None without a zero."""
    quiet, zeros = replace(plant, noise=()), []
    for share in (0.4, 0.6):
        shot = shoot(quiet, low + share * (high - low), 0.3 * (high - low), omega, degree, np.random.default_rng(0))
        real = real_roots(curve_of(shot))
        if not len(real):
            return None
        zeros.append(float(real[np.argmin(np.abs(real))]))
    return (zeros[1] - zeros[0]) / (0.2 * (high - low))
