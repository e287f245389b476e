"""Steady tones in a residual: hum with its harmonics."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.fit import Estimate, Parameter, least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats

RARE = 1e-4  # chance that noise alone shows a tone somewhere in the spectrum
NEIGHBOURS = 200  # lines on either side whose median is the noise around a line
FEWEST = 50  # periods in the record: fewer are drift
HIGHEST = 7  # harmonic that is looked for


class Interference(NamedTuple):
    """A tone and its harmonics in the residual, with a phase that holds over the whole record."""

    omega: Annotated[float, Quantity("rad/s", error="omega_std")]
    omega_std: Annotated[float, Quantity("rad/s")]
    harmonics: Annotated[NDArray[np.intp], Quantity("1", ("harmonic",))]
    cos: Annotated[Floats, Quantity("output", ("harmonic",))]
    sin: Annotated[Floats, Quantity("output", ("harmonic",))]
    std: Annotated[Floats, Quantity("output", ("harmonic",))]  # of either
    before: Annotated[float, Quantity("output")]  # rms of the residual
    after: Annotated[float, Quantity("output")]
    estimate: Estimate

    @property
    def found(self) -> bool:
        """Tell whether there is a tone."""
        return len(self.harmonics) > 0

    def table(self) -> Table:
        """Return one row a harmonic."""
        size = np.hypot(self.cos, self.sin)
        rows = tuple(
            (float(f"{h * self.omega / (2 * np.pi):.7g}"), int(h), Measured(float(a), float(s)))
            for h, a, s in zip(self.harmonics, size, self.std, strict=True)
        )
        note = f"rms {self.before:.5g} before, {self.after:.5g} after" if self.found else "no steady tone in the residual"
        return Table("Interference", ("frequency Hz", "harmonic", "amplitude"), rows, (note,))


def interference(residual: Floats, use: NDArray[np.bool_], dt: float, t0: float = 0.0) -> Interference:
    """Look for the strongest tone that noise does not explain, then for its harmonics; amplitudes and frequency jointly.

    e(t) = Σ_h a_h cos(hωt) + b_h sin(hωt) + noise. A line is a tone where the periodogram exceeds log(lines/RARE) times the
    noise around it, a harmonic where its own amplitude has p < RARE. residual (N,), use (N,) where it counts.
    """
    none = np.empty(0)
    e = np.where(use, residual, 0.0)
    before = float(np.sqrt(np.mean(residual[use] ** 2)))
    empty = Estimate((), none, none, np.empty((0, 0)), 0, np.empty((0, 0)), 0.0, 0, 0, "linear")
    nothing = Interference(np.nan, np.nan, np.empty(0, np.intp), none, none, none, before, before, empty)
    if use.sum() < 4 * NEIGHBOURS:
        return nothing
    line = _strongest(e)
    if line is None:
        return nothing
    time: Floats = np.asarray(t0 + dt * np.flatnonzero(use), np.float64)
    omega = _refined(residual[use], time, 2 * np.pi * line / (len(e) * dt), 2 * np.pi / (len(e) * dt))
    candidates = [h for h in range(1, HIGHEST + 1) if h * omega * dt < np.pi]
    a = _amplitudes(residual[use], omega, time, candidates)
    level = np.sqrt(2 * _noise_at(e, [h * omega * len(e) * dt / (2 * np.pi) for h in candidates]) / use.sum())
    kept = [k for k, h in enumerate(candidates) if h == 1 or np.hypot(*a[:, k]) > level[k] * np.sqrt(-2 * np.log(RARE))]
    return _joint(residual[use], time, omega, np.array(candidates)[kept], level[kept], before)


def _strongest(e: Floats) -> float | None:
    """Return the place of the strongest line that stands out of its surroundings, in cycles a record."""
    power = np.abs(np.fft.rfft(e * np.hanning(len(e)))) ** 2
    around = _around(power)
    ratio = power[FEWEST:-1] / around[FEWEST:-1]
    best = int(np.argmax(ratio)) + FEWEST
    stands_out = ratio[best - FEWEST] > np.log(len(power) / RARE)
    return float(best) if stands_out else None


def _around(power: Floats) -> Floats:
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(power, 2 * NEIGHBOURS + 1, mode="reflect") / np.log(2))


def _noise_at(e: Floats, lines: list[float]) -> Floats:
    """Return the variance of noise as if it were white with the density around each line."""
    around = _around(np.abs(np.fft.rfft(e)) ** 2 / max(np.count_nonzero(e), 1))
    return np.array([around[min(round(line), len(around) - 1)] for line in lines])


def _amplitudes(e: Floats, omega: float, time: Floats, harmonics: list[int]) -> Floats:
    """Return (2, H): cos and sin amplitudes."""
    return np.array([[2 * np.mean(e * wave(h * omega * time)) for h in harmonics] for wave in (np.cos, np.sin)])


def _refined(e: Floats, time: Floats, omega: float, line: float) -> float:
    """Return the frequency of the highest power within a line of a first guess."""
    from scipy.optimize import minimize_scalar

    def power(w: float) -> float:
        return -float(abs(np.mean(e * np.exp(-1j * w * time))))

    return float(
        minimize_scalar(power, bounds=(omega - line, omega + line), method="bounded", options={"xatol": 1e-4 * line}).x
    )


def _joint(e: Floats, time: Floats, omega: float, harmonics: NDArray[np.intp], level: Floats, before: float) -> Interference:
    count = len(harmonics)
    start = _amplitudes(e, omega, time, list(harmonics)).ravel()

    def waves(w: float) -> tuple[Floats, Floats]:
        turn = w * time * harmonics[:, None]
        return np.cos(turn), np.sin(turn)

    def residual(x: Floats) -> Floats:
        c, s = waves(x[0])
        return np.asarray(x[1 : count + 1] @ c + x[count + 1 :] @ s - e)

    def tangent(x: Floats) -> Floats:
        c, s = waves(x[0])
        turning = (harmonics * x[count + 1 :]) @ (c * time) - (harmonics * x[1 : count + 1]) @ (s * time)
        return np.vstack([turning, c, s]).T

    names = ["omega", *(f"cos.{k}" for k in range(count)), *(f"sin.{k}" for k in range(count))]
    free = [Parameter(name, float(v)) for name, v in zip(names, [omega, *start], strict=True)]
    estimate = least_squares(residual, tangent, free, max_iterations=20, tolerance=0.01)
    after = float(np.sqrt(np.mean(residual(estimate.values) ** 2)))
    x = estimate.values
    return Interference(
        float(x[0]), float(estimate.std[0]), harmonics, x[1 : count + 1], x[count + 1 :], level, before, after, estimate
    )
