"""The steady loop of a backlash behind a sine: where it holds, where it follows, and how that changes with every number."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from whid.fit import Estimate
from whid.signal import Floats

TOUCH = 4.0  # standard errors of a sample of the averaged period
END = 1e-9
CYCLES = 4  # after so many turns of the sine the loop repeats
FULL, ONE_SIDED, CONSTANT = "full", "one-sided", "constant"


class Swing(NamedTuple):
    """One averaged period of the output, and the sine that made it."""

    omega: float  # rad/s
    drive: complex  # phasor of the input sine
    mean: Floats  # (M,) from the part's start
    std: Floats  # (M,)
    periods: int

    @property
    def angle(self) -> Floats:
        """Return the angle of the input sine at every sample."""
        return 2 * np.pi * np.arange(len(self.mean)) / len(self.mean) + float(np.angle(self.drive))

    @property
    def touch(self) -> float:
        """Return what noise may make of two borders that meet."""
        return TOUCH * float(self.std.mean())

    @property
    def amplitude(self) -> float:
        """Return U."""
        return abs(self.drive)


class Lumped(NamedTuple):
    """Phase, and borders in powers of cos(ωt + arg drive + phase), from one sine ([Giri], eq. (12))."""

    omega: float
    amplitude: float
    phase: float
    phase_std: float
    rising: Floats
    rising_std: Floats
    falling: Floats
    falling_std: Floats


class Loop(NamedTuple):
    """One steady period of w over z = cos θ ∈ [−1, 1], borders as polynomials in z.

    Held at the top from z = 1 down to `down`, then along the falling border; at the bottom from −1 up to `up`, then along
    the rising one; NaN where the border is never met. top, bottom: rows of coefficients (2n + 2: rising, falling) of
    the values held, so that each is row @ borders.
    """

    up: float
    down: float
    top: Floats
    bottom: Floats

    @property
    def kind(self) -> str:
        """Return full (both borders met), one-sided, or constant: the output does not move."""
        met = np.array([self.up < 1 - END, self.down > END - 1])  # met where the run ends, a border moves nothing
        return FULL if met.all() else ONE_SIDED if met.any() else CONSTANT


def steady_loop(rising: Floats, falling: Floats, touch: float = 0.0) -> Loop:
    """Return the loop that a sine of amplitude 1 settles on, started on the rising border at its top.

    touch: where a border is never met, but begins this near to what is held, it is followed from its start. A loop that
    closes at its ends has no stage there, and noise in the borders must not make a fit of it stick.

    >>> loop = steady_loop(np.array([-0.2, 1.0]), np.array([0.2, 1.0]))
    >>> loop.kind, round(loop.down, 6), round(loop.up, 6)
    ('full', 0.6, -0.6)
    """
    n = len(rising)
    ends = np.array([1.0, -1.0])[:, None] ** np.arange(n)  # z = 1, z = −1
    highest, lowest = np.append(ends[0], np.zeros(n)), np.append(np.zeros(n), ends[1])
    both = np.append(rising, falling)
    top, bottom, up, down = highest, highest, np.nan, np.nan
    for _ in range(CYCLES):
        down = _first(falling, float(top @ both), -1.0, touch)
        bottom = lowest if np.isfinite(down) else top
        up = _first(rising, float(bottom @ both), 1.0, touch)
        top = highest if np.isfinite(up) else bottom
        if np.isfinite(up) and np.isfinite(down):
            break
    return Loop(up, down, top, bottom)


def _first(border: Floats, w: float, way: float, touch: float) -> float:
    """Return the first z on the way from −way to way at which the border is w, NaN where it is never."""
    start = float(np.polynomial.polynomial.polyval(-way, border))
    if abs(start - w) <= 1e-12 * (1 + abs(start)):
        return -way
    shifted = border.copy()
    shifted[0] -= w
    if len(border) == 2:
        roots = np.array([-shifted[0] / shifted[1]]) if shifted[1] else np.empty(0)
    else:
        trimmed = np.trim_zeros(shifted[::-1], "f")
        roots = np.roots(trimmed) if len(trimmed) > 1 else np.empty(0)
    real = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
    inside = real[np.abs(real) <= 1]
    if not len(inside):
        return -way if abs(start - w) <= touch else float("nan")
    return float(inside[np.argmin(way * inside)])


def response(rising: Floats, falling: Floats, angle: Floats, touch: float = 0.0) -> tuple[Floats, Floats, Floats]:
    """Return w at angles θ of the sine, its derivative with respect to θ, and to the 2n + 2 coefficients.

    >>> w, *_ = response(np.array([-0.2, 1.0]), np.array([0.2, 1.0]), np.array([0.0, np.pi / 2, np.pi]))
    >>> w.round(6)
    array([ 0.8,  0.2, -0.8])
    """
    loop, n = steady_loop(rising, falling, touch), len(rising)
    z, s = np.cos(angle), np.sin(angle)
    powers = z[:, None] ** np.arange(n)
    down = s >= 0
    follows = np.where(down, z <= loop.down, z >= loop.up)  # NaN: never
    rows = np.zeros((len(z), 2 * n))
    for side, first in ((~down, 0), (down, n)):
        here = follows & side
        rows[here, first : first + n] = powers[here]
    rows[~follows & down], rows[~follows & ~down] = loop.top, loop.bottom
    slopes = [np.polynomial.polynomial.polyval(z, np.polynomial.polynomial.polyder(b)) for b in (rising, falling)]
    slope = np.where(down, slopes[1], slopes[0])
    return rows @ np.append(rising, falling), np.where(follows, -s * slope, 0.0), rows


def dual(rising: Floats, falling: Floats) -> tuple[Floats, Floats]:
    """Return the borders of F[−x], which with −G(s) makes the same system ([Giri], eq. (7))."""
    sign = (-1.0) ** np.arange(len(rising))
    return falling * sign, rising * sign


def remembered(function: Callable[[Floats], tuple[Floats, Floats]]) -> Callable[[Floats], tuple[Floats, Floats]]:
    """Return a function of θ that keeps its last answer: residual and tangent are asked for one after another."""
    last: list[tuple[bytes, tuple[Floats, Floats]]] = []

    def asked(theta: Floats) -> tuple[Floats, Floats]:
        key = theta.tobytes()
        if not last or last[0][0] != key:
            last[:] = [(key, function(theta))]
        return last[0][1]

    return asked


def lumped(found: Estimate, omega: float, amplitude: float) -> Lumped:
    """Return an estimate of (phase, rising, falling) with its phase in (−π/2, π/2], borders mirrored to match."""
    n = (len(found.values) - 1) // 2
    phase = float(np.pi / 2 - np.mod(np.pi / 2 - found.values[0], np.pi))
    values, std = (np.split(x[1:], 2) for x in (found.values, found.std))
    if round((float(found.values[0]) - phase) / np.pi) % 2:
        values = list(dual(*values))
        std = std[::-1]
    assert len(values[0]) == n
    return Lumped(omega, amplitude, phase, float(found.std[0]), values[0], std[0], values[1], std[1])


def other_branch(found: Lumped) -> Lumped:
    """Return the same sine seen with −G and F[−x]."""
    rising, falling = dual(found.rising, found.falling)
    phase = found.phase - np.pi if found.phase > 0 else found.phase + np.pi
    return found._replace(
        phase=phase, rising=rising, falling=falling, rising_std=found.falling_std, falling_std=found.rising_std
    )
