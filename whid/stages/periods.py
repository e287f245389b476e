"""Periodic parts: one averaged period, its harmonics with honest errors, and the sine that drives it."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.fit import Parameter, least_squares, linear_least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._noise_test import equal

Complexes = NDArray[np.complex128]

_WHITE = np.empty(0)
_LINES = 16  # spectral lines at least behind a standard error: with 4 a 95 % interval covers 88 %
_ALIKE = 0.05  # p of Bartlett's test above which all orders share one noise: weights from 36 degrees of freedom each scatter
_BLOCK = 16384  # samples of a regression held as rows at a time


class PeriodAverage(NamedTuple):
    """Period average: one period of the output, averaged over periods."""

    phase: Annotated[Floats, Quantity("sample", ("phase",))]  # (n,) from the first sample of the part
    mean: Annotated[Floats, Quantity("output", ("phase",), error="mean_std")]
    mean_std: Annotated[Floats, Quantity("output", ("phase",))]
    periods: int
    noise_std: Annotated[float, Quantity("output")]  # of one sample

    def table(self) -> Table:
        """Return one row: the averaged period in figures."""
        row = (len(self.phase), self.periods, float(f"{self.noise_std:.3g}"), float(f"{np.ptp(self.mean):.6g}"))
        return Table("Period average", ("samples a period", "periods", "noise std", "swing"), (row,))


class Harmonics(NamedTuple):
    """Harmonics of a periodic output, y(t) = Re Σ value[k] exp(jkωt), t from the first sample of the part."""

    order: Annotated[NDArray[np.intp], Quantity("1", ("order",))]
    value: Annotated[Complexes, Quantity("output", ("order",), error="value_std")]
    value_std: Annotated[Floats, Quantity("output", ("order",))]  # of the real part, and of the imaginary part
    own_std: Annotated[Floats, Quantity("output", ("order",))]  # from lines that no other harmonic's error has
    own_lines: int  # those lines: 2·own_lines degrees of freedom
    noise_std: Annotated[float, Quantity("output")]  # of one sample
    period: Annotated[float, Quantity("sample")]
    periods: int

    @property
    def heard(self) -> bool:
        """Tell whether anything but the mean stands out of the noise, by five standard errors."""
        return bool((np.abs(self.value[1:]) > 5 * self.value_std[1:]).any())

    def table(self) -> Table:
        """Return amplitude and phase of each harmonic that stands out of the noise."""
        rows = []
        for k, value, std in zip(self.order, self.value, self.value_std, strict=True):
            size = float(abs(value))
            if k < 2 or size > 4 * std:
                phase = Measured(float(np.angle(value)), float(std / size)) if k and size else None
                rows.append((int(k), Measured(float(value.real) if k == 0 else size, float(std)), phase))
        length = f"{self.periods} periods of {self.period:.6g} samples, orders to {self.order[-1]}"
        notes = (f"{length}, noise std {self.noise_std:.3g}",)
        return Table("Harmonics", ("order", "amplitude, output", "phase, rad"), tuple(rows), notes)


class SineFit(NamedTuple):
    """Sine fit: u(n) = offset + amplitude·cos(2πn/period + phase), n from the first sample."""

    offset: Annotated[float, Quantity("input", error="offset_std")]
    amplitude: Annotated[float, Quantity("input", error="amplitude_std")]
    phase: Annotated[float, Quantity("rad", error="phase_std")]
    period: Annotated[float, Quantity("sample", error="period_std")]
    offset_std: Annotated[float, Quantity("input")]
    amplitude_std: Annotated[float, Quantity("input")]
    phase_std: Annotated[float, Quantity("rad")]
    period_std: Annotated[float, Quantity("sample")]
    noise_std: Annotated[float, Quantity("input")]

    def table(self) -> Table:
        """Return one row of the four numbers."""
        names = ("offset", "amplitude", "phase", "period")
        row = tuple(Measured(getattr(self, name), getattr(self, f"{name}_std")) for name in names)
        return Table("Sine", ("offset, input", "amplitude, input", "phase, rad", "period, samples"), (row,))


def period_average(y: Floats, period: float, skip: int = 1, count: int = 20) -> PeriodAverage:
    """Average the periods of a periodic output after the first `skip` of them.

    A whole number of samples a period: exact folding, x̂(t) = Σ y(t + pT)/L, with errors from the scatter between periods.
    Otherwise, or with a whole phase missing: the Fourier sum of `count` harmonics fitted on the true times. y (N,), NaN
    where missing; period in samples. Raises `WhidError("stage-too-short")`. Source [Brouri2019], eq. (3.25).

    >>> y = np.cos(2 * np.pi * np.arange(100) / 20)
    >>> found = period_average(y, 20, skip=1)
    >>> found.periods, found.mean[:2].round(3)
    (4, array([1.   , 0.951]))
    """
    first, stop, periods = _window(len(y), period, skip)
    n = round(period)
    if _whole(period):
        folded = y[first:stop].reshape(periods, n)
        seen = np.isfinite(folded).sum(axis=0)
        if seen.min() > 0:
            mean = np.asarray(np.nanmean(folded, axis=0), float)
            dof = int((seen - 1).sum())
            noise = float(np.sqrt(np.nansum((folded - mean) ** 2) / dof)) if dof else float("inf")
            return PeriodAverage(np.arange(n, dtype=np.float64), mean, noise / np.sqrt(seen), periods, noise)
    found = harmonics(y, period, skip, count)
    phase = np.arange(n, dtype=np.float64) * (period / n)
    turn = np.exp(2j * np.pi * np.outer(phase / period, found.order))
    std = np.full(n, np.sqrt(np.sum(found.value_std**2)))  # cos² + sin² = 1: the same at every phase
    return PeriodAverage(phase, np.real(turn @ found.value), std, periods, found.noise_std)


def harmonics(y: Floats, period: float, skip: int = 1, count: int = 20, ar: Floats = _WHITE) -> Harmonics:
    """Return the harmonics 0 … count of a periodic output, after the first `skip` periods.

    A whole number of samples a period and nothing missing: exact by FFT; else least squares on the true times. The noise
    of harmonic k is that of the (P − 1)/2 spectral lines on either side of it, P the number of periods, and of at least 8:
    right for coloured noise, where white-noise formulas are far off, and independent of the harmonics; infinite when P = 1.
    Where Bartlett's test finds the noise of all orders alike (p > 0.05) they share its mean.
    ar: the noise's colour where it is known, e(n) = Σ ar[k] e(n − 1 − k) + …; of it the shape counts, not the size.
    y (N,), NaN where missing; period in samples, any real number > 2. Raises `WhidError("stage-too-short")`.
    Source [Brouri2019], eq. (3.24)-(3.25).

    >>> n = np.arange(500)
    >>> found = harmonics(3 + np.cos(2 * np.pi * n / 50 - 0.5), 50, skip=1, count=2)
    >>> np.abs(found.value).round(6), round(float(np.angle(found.value[1])), 6)
    (array([3., 1., 0.]), -0.5)
    """
    return spectrum(y, period, skip, count).harmonics(ar)


class Spectrum(NamedTuple):
    """Harmonics of a window of whole periods, and the power at all its lines but theirs."""

    value: Complexes
    power: Floats  # |rfft|², of what the harmonics leave over where they were fitted
    noise_std: float
    window: Window

    def harmonics(self, ar: Floats = _WHITE) -> Harmonics:
        """Return the harmonics with their errors, for noise of a colour."""
        return of_lines(self.value, self.power, self.noise_std, self.window, ar)


def spectrum(y: Floats, period: float, skip: int = 1, count: int = 20, start: int = 0) -> Spectrum:
    """Return the spectrum of whole periods, phases counted from the first sample of the part, which is sample `start`."""
    first, stop, periods = _window(len(y), period, skip)
    count = min(count, int(np.ceil(period / 2)) - 1)
    window = y[first:stop]
    valid = np.isfinite(window)
    if _whole(period) and valid.all() and start % round(period) == 0:
        lines = np.fft.rfft(window)
        value = lines[: count * periods + 1 : periods] * 2 / len(window)
        value[0] /= 2
    else:
        value, residual = _regression(window, valid, start + first, 2 * np.pi / period, count)
        lines = np.fft.rfft(residual)
    power, samples = np.abs(lines) ** 2, int(valid.sum())
    between = np.arange(len(power)) % periods != 0
    noise = float(np.sqrt(power[between].mean() / samples)) if between.any() else float("inf")
    return Spectrum(value, power, noise, Window(float(period), periods, len(window), samples))


class Window(NamedTuple):
    """Whole periods of a record: samples, of which some may be missing."""

    period: float
    periods: int
    length: int
    valid: int

    def lines(self, count: int, fewest: int = _LINES) -> NDArray[np.intp]:
        """Return the lines (count + 1, n) on either side of each harmonic: n = P − 1, or `fewest` if more.

        Those of the mean (k = 0) are all on one side: below, the lines are the same ones mirrored.
        """
        half = max((self.periods - 1) // 2, (fewest + 1) // 2, 1)
        away = np.arange(1, 4 * half + 4)
        away = away[away % self.periods != 0][: 2 * half]
        near = np.abs(np.arange(count + 1)[:, None] * self.periods + np.append(-away[:half], away[:half]))
        near[0] = away
        return np.asarray(np.minimum(near, self.length // 2))


def of_lines(value: Complexes, power: Floats, noise_std: float, window: Window, ar: Floats = _WHITE) -> Harmonics:
    """Return harmonics 0 … of a window with the noise of the spectral lines beside them; power: |spectrum|² by line."""
    order = np.arange(len(value))
    if window.periods == 1:
        endless = np.full(len(value), np.inf)
        return Harmonics(order, value, endless, endless, 0, noise_std, window.period, 1)
    near, own = window.lines(len(order) - 1), window.lines(len(order) - 1, 0)
    at = _shape(ar, order * window.periods, window.length)
    shared = np.mean(power[near] / _shape(ar, near, window.length), axis=1)
    if equal(shared, near.shape[1], _ALIKE):
        shared = np.full(len(shared), shared.mean())
    part = np.sqrt(np.where(order == 0, 1.0, 2.0)) / window.valid
    alone = part * np.sqrt(np.mean(power[own], axis=1))
    return Harmonics(
        order, value, part * np.sqrt(at * shared), alone, own.shape[1], noise_std, window.period, window.periods
    )  # fmt: skip


def fit_sine(u: Floats, period_guess: float) -> SineFit:
    """Fit offset, amplitude, phase and period of a sampled sine by least squares.

    The guess may be off by two periods over the whole length: the spectrum within is searched first. u (N,), NaN where
    missing; errors from the residual, taken as white. Raises `WhidError("stage-too-short")` below one period.

    >>> n = np.arange(1000)
    >>> found = fit_sine(2 + 0.5 * np.cos(2 * np.pi * n / 200.25 + 0.3), 200)
    >>> round(found.period, 6), round(found.amplitude, 6), round(found.phase, 6)
    (200.25, 0.5, 0.3)
    """
    _window(len(u), period_guess, 0)
    seen = np.flatnonzero(np.isfinite(u))
    data, start = u[seen], seen.mean()
    n = seen - start  # from the middle: phase and period are then nearly independent
    trial = 2 * np.pi * (1 / period_guess + np.linspace(-2, 2, 33) / len(u))
    trial = trial[trial > np.pi / len(u)]
    power = [abs(np.exp(-1j * w * n) @ (data - data.mean())) for w in trial]
    omega = float(trial[np.argmax(power)])
    linear = linear_least_squares(_sine_design(n, omega), data)
    parameters = [Parameter(name, float(x)) for name, x in zip(("offset", "re", "im"), linear.values, strict=True)]

    def residual(p: Floats) -> Floats:
        return np.asarray(_sine_design(n, p[3]) @ p[:3] - data)

    def tangent(p: Floats) -> Floats:
        design = _sine_design(n, p[3])
        return np.column_stack([design, n * (design[:, 2] * p[1] - design[:, 1] * p[2])])

    found = least_squares(residual, tangent, [*parameters, Parameter("omega", omega)])
    offset, re, im, omega = (float(x) for x in found.values)
    amplitude = float(np.hypot(re, im))
    to_polar = np.array([[re, im], [-im / amplitude, re / amplitude]]) / amplitude
    change = np.zeros((4, 4))
    change[0, 0] = 1
    change[1:3, 1:3] = to_polar
    change[2, 3] = -start  # the phase at the first sample
    change[3, 3] = -2 * np.pi / omega**2
    std = np.sqrt(np.diag(change @ found.covariance @ change.T))
    phase = float(np.angle(complex(re, im) * np.exp(-1j * omega * start)))
    noise = float(np.sqrt(found.reduced_chi2))
    a, b, c, d = (float(s) for s in std)
    return SineFit(offset, amplitude, phase, 2 * np.pi / omega, a, b, c, d, noise)


def _whole(period: float) -> bool:
    return abs(period - round(period)) < 1e-9 * period


def _window(samples: int, period: float, skip: int) -> tuple[int, int, int]:
    """Return first and last sample (half-open) of the whole periods after the lead, and their number."""
    if not period > 2:
        raise WhidError("stage-too-short", f"a period of {period:.4g} samples is too short: more than 2 are needed")
    first = int(np.ceil(skip * period - 1e-6))
    periods = int((samples - first + 0.5) // period)
    if periods < 1:
        raise WhidError(
            "stage-too-short", f"{samples} samples hold no whole period of {period:.6g} after {skip} lead periods"
        )
    return first, min(samples, first + round(periods * period)), periods


def _regression(window: Floats, valid: NDArray[np.bool_], first: int, omega: float, count: int) -> tuple[Complexes, Floats]:
    """Return the harmonics by least squares on the valid samples, and the residual, 0 where missing.

    Rows are reduced to a triangle block by block, so that a long record needs no matrix of its length.
    """
    blocks = [slice(k, min(k + _BLOCK, len(window))) for k in range(0, len(window), _BLOCK)]
    triangle = np.empty((0, 2 * count + 2))
    for rows in blocks:
        known = np.column_stack([_fourier(rows, first, omega, count), window[rows]])[valid[rows]]
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, known]), mode="r"))
    fitted = linear_least_squares(triangle[:, :-1], triangle[:, -1]).values
    residual = np.empty(len(window))
    for rows in blocks:
        residual[rows] = np.where(valid[rows], window[rows] - _fourier(rows, first, omega, count) @ fitted, 0.0)
    return np.append(fitted[0], fitted[1 : count + 1] + 1j * fitted[count + 1 :]), residual


def _fourier(rows: slice, first: int, omega: float, count: int) -> Floats:
    """Return columns 1, cos kωn, −sin kωn, so that their factors are Re and Im of the harmonics."""
    turn = np.exp(1j * omega * np.arange(first + rows.start, first + rows.stop))
    powers = np.cumprod(np.broadcast_to(turn[:, None], (len(turn), count)), axis=1)
    return np.column_stack([np.ones(len(turn)), powers.real, -powers.imag])


def _shape(ar: Floats, line: NDArray[np.intp], samples: int) -> Floats:
    """Return the spectrum of an autoregression, up to a factor, at lines of the Fourier transform of that many samples."""
    if not len(ar):
        return np.ones(line.shape)
    turn = np.exp(-2j * np.pi * line / samples)
    return np.asarray(1 / np.abs(np.polynomial.polynomial.polyval(turn, np.append(1.0, -ar))) ** 2)


def _sine_design(n: Floats, omega: float) -> Floats:
    return np.column_stack([np.ones(len(n)), np.cos(omega * n), -np.sin(omega * n)])
