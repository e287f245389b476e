"""Sines in a signal, one after another, under noise or exact: offset, amplitude, period, phase and where they end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.fit import Parameter, least_squares
from whid.signal import Floats

FIRST_WINDOW, GROWTH = 12, 1.5  # samples, factor: windows in which a sine is looked for
LONGEST_WINDOW = 20_000  # samples, away from the start of a stretch
ANCHORS, HOP = 16, 50  # places of a stretch, samples apart at least, from which a sine is looked for
FEWEST_PERIODS = 1.9
DISTORTED = 0.05  # residual / amplitude: more is no sine
WHITE = 0.3  # von Neumann ratio of the residual below which it is a shape, not noise
FITTED, GUESSED = 100_000, 1000  # samples at most that a fit, and a first guess, looks at
WITHIN = 4.0  # standard errors of a period within which a whole number of samples is meant
BELIEVED = 0.05  # samples: a period that is known no better than this is not made whole (one in ten is so near by chance)
FAR = 6.0  # residual standard deviations that end a sine, when four of six samples are so far


class Found(NamedTuple):
    """u(n) = offset + amplitude·cos(2π(n − start)/period + phase), samples start … stop − 1."""

    start: int
    stop: int
    offset: float
    amplitude: float
    period: float
    phase: float
    rms: float  # of the residual

    def at(self, n: Floats) -> Floats:
        """Return the sine at samples n, counted as start is."""
        return np.asarray(self.offset + self.amplitude * np.cos(2 * np.pi * (n - self.start) / self.period + self.phase))

    def of_whole_samples(self) -> Found:
        """Return the sine with a period of whole samples, where one lies within the period's error; else as it is.

        The Cramér-Rao bound of a frequency from N samples under white noise is √(24/N³)·rms/amplitude, in rad per sample.
        The phase is kept where it is known best, in the middle.
        """
        length = self.stop - self.start
        error = self.period**2 / (2 * np.pi) * np.sqrt(24 / min(length, FITTED)) / length * self.rms / self.amplitude
        whole = round(self.period)
        if not abs(whole - self.period) <= WITHIN * error <= BELIEVED:
            return self
        turned = np.pi * length * (1 / self.period - 1 / whole)
        return self._replace(period=float(whole), phase=float((self.phase + turned + np.pi) % (2 * np.pi) - np.pi))


def find_sines(u: Floats, start: int, stop: int, bit: float) -> list[Found]:
    """Return the sines among samples start … stop − 1, in order."""
    found: list[Found] = []
    anchor, hop = start, max(HOP, (stop - start) // ANCHORS)
    while stop - anchor >= FIRST_WINDOW:
        sine = _first(u, anchor, stop, bit, found[-1].stop if found else start)
        if sine is not None:
            found.append(sine)
        anchor = sine.stop if sine is not None else anchor + hop
    return found


def fitted(u: Floats, start: int, stop: int, guess: Found, most: int = FITTED) -> Found:
    """Return the least-squares sine of samples start … stop − 1 (of `most` of them), from a guess."""
    n = np.arange(start, stop, max(1, (stop - start) // most), dtype=float)
    x, t = u[n.astype(int)], n - 0.5 * (start + stop)  # centred: period and phase hardly correlate
    w0 = 2 * np.pi / guess.period
    angle = guess.phase + w0 * (0.5 * (start + stop) - guess.start)
    begin = (guess.offset, guess.amplitude * np.cos(angle), -guess.amplitude * np.sin(angle), 0.0)
    scale = 1 / max(stop - start, 1)  # of the frequency's change: a radian over the stretch

    def basis(theta: Floats) -> tuple[Floats, Floats]:
        return np.cos((w0 + theta[3] * scale) * t), np.sin((w0 + theta[3] * scale) * t)

    def residual(theta: Floats) -> Floats:
        c, s = basis(theta)
        return np.asarray(theta[0] + theta[1] * c + theta[2] * s - x)

    def tangent(theta: Floats) -> Floats:
        c, s = basis(theta)
        return np.stack([np.ones_like(c), c, s, scale * t * (theta[2] * c - theta[1] * s)], axis=1)

    names = ("offset", "cos", "sin", "frequency")
    fit = least_squares(residual, tangent, [Parameter(k, v) for k, v in zip(names, begin, strict=True)], max_iterations=30)
    offset, a, b, change = map(float, fit.values)
    w = w0 + change * scale
    phase = np.arctan2(-b, a) - w * 0.5 * (stop - start)
    wrapped = float((phase + np.pi) % (2 * np.pi) - np.pi)
    return Found(
        start, stop, offset, float(np.hypot(a, b)), float(2 * np.pi / w), wrapped, float(np.sqrt(fit.chi2 / len(x)))
    )


def _first(u: Floats, start: int, stop: int, bit: float, earliest: int) -> Found | None:
    """Return the sine that begins at (or about) start."""
    size = float(FIRST_WINDOW)
    longest = stop - start if start == earliest else min(stop - start, LONGEST_WINDOW)
    while True:
        end = start + min(int(size), longest)
        guess = _guess(u, start, end, bit)
        if guess is not None:
            sine = _extended(u, fitted(u, start, end, guess), stop, earliest, bit)
            if sine is not None and sine.stop - sine.start >= FEWEST_PERIODS * sine.period:
                return sine
        if end == start + longest:
            return None
        size *= GROWTH


def _guess(u: Floats, start: int, stop: int, bit: float) -> Found | None:
    """Return the sine at the strongest line of the window's spectrum, if it explains the window."""
    x = u[start:stop] - u[start:stop].mean()
    if np.ptp(x) <= 6 * bit or np.ptp(x) == 0:
        return None
    n = len(x)
    spectrum = np.abs(np.fft.rfft(x * np.hanning(n), 4 * n))
    k = int(spectrum[2:-1].argmax()) + 2
    if k < 4 or not _swings(x, max(1, round(n / k))):  # less than one period in the window; or no sine
        return None
    best: Found | None = None
    for period in {4 * n / (k + d) for d in (-1.5, 0.0, 1.5)}:  # the line is broad when the window has few periods
        trial = fitted(
            u, start, stop, Found(start, stop, float(u[start:stop].mean()), float(np.ptp(x) / 2), period, 0.0, 0.0)
        )
        best = trial if best is None or trial.rms < best.rms else best
    return best if best is not None and _explains(u, best, bit) and (stop - start) >= 1.2 * best.period > 2.4 else None


def _swings(x: Floats, quarter: int) -> bool:
    """Tell cheaply whether x may be a sine: x(n + q) + x(n − q) = a + b·x(n), best seen at a quarter period."""
    if len(x) < 2 * quarter + 4:
        return True
    middle, sides = x[quarter:-quarter], x[2 * quarter :] + x[: -2 * quarter]
    middle, sides = middle - middle.mean(), sides - sides.mean()
    slope = (middle @ sides) / max(float(middle @ middle), 1e-300)
    left = np.sum((sides - slope * middle) ** 2)
    return bool(abs(slope) < 1.3 and left <= (4 * DISTORTED) ** 2 * len(sides) * x.var())


def _explains(u: Floats, sine: Found, bit: float) -> bool:
    """Tell whether what the sine leaves is small, and noise rather than a shape."""
    if not sine.rms <= DISTORTED * sine.amplitude:
        return False
    if sine.rms <= max(0.6 * bit, 1e-9 * sine.amplitude):
        return True
    left = u[sine.start : sine.stop] - sine.at(np.arange(sine.start, sine.stop, dtype=float))
    return bool(np.mean(np.diff(left) ** 2) / 2 >= WHITE * np.mean(left**2))


def _extended(u: Floats, sine: Found, stop: int, earliest: int, bit: float) -> Found | None:
    """Return the sine followed as far as it goes, fitted again as it grows; None where it turns out not to be one."""
    while sine.stop < stop:
        ahead = min(stop, sine.stop + max(32, sine.stop - sine.start))
        good = _good(u, sine, sine.stop, ahead, bit)
        sine = fitted(u, sine.start, sine.stop + good, sine)
        if not _explains(u, sine, bit):
            return None
        if sine.stop < ahead:
            break
    if earliest < sine.start:
        behind = u[::-1][len(u) - sine.start : len(u) - earliest]
        good = _run(np.abs(behind - sine.at(np.arange(sine.start - 1, earliest - 1, -1.0))) <= _tolerance(sine, bit))
        sine = fitted(u, sine.start - good, sine.stop, sine)
    return sine if _explains(u, sine, bit) else None


def _good(u: Floats, sine: Found, first: int, last: int, bit: float) -> int:
    """Return how many samples from `first` on the sine still explains."""
    return _run(np.abs(u[first:last] - sine.at(np.arange(first, last, dtype=float))) <= _tolerance(sine, bit))


def _tolerance(sine: Found, bit: float) -> float:
    return max(FAR * sine.rms, 1.5 * bit, 1e-8 * sine.amplitude)


def _run(fits: NDArray[np.bool_]) -> int:
    """Return the length of the run at the start: up to a misfit that four of six samples share, or misfits to the end."""
    if not len(fits):
        return 0
    misfit = np.concatenate([~fits, np.full(5, not fits[-1])])
    count = np.concatenate([[0], np.cumsum(misfit)])
    ends = misfit[:-5] & (count[6:] - count[:-6] >= 4)
    return int(ends.argmax()) if ends.any() else len(fits)
