"""Least squares of many sines at once: borders in one unit of x, a gain and a phase a frequency in any parametrisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from whid.fit import Estimate, Parameter, least_squares
from whid.signal import Floats
from whid.stages._hysteresis import Swing, remembered, response


class Gains(NamedTuple):
    """log |G| and arg G at every sine, and their derivatives with respect to the numbers of G."""

    log_gain: Floats  # (R,)
    phase: Floats  # (R,)
    by_log_gain: Floats  # (R, p)
    by_phase: Floats  # (R, p)


class LoopFit(NamedTuple):
    """Σ over sines and samples of ((w − mean)/std)², w the steady loop of x = U|G| cos(ωt + arg drive + arg G)."""

    swings: Sequence[Swing]
    degree: int
    linear: Callable[[Floats], Gains]
    static: bool = False  # one curve: both borders are the same

    def solve(self, rising: Floats, falling: Floats, linear: Sequence[Parameter], max_iterations: int = 60) -> Estimate:
        """Fit borders (per power of x) and the numbers of G from a start."""
        n = self.degree + 1
        sides = (("curve", rising),) if self.static else (("rising", rising), ("falling", falling))
        free = [Parameter(f"{side}.{k}", float(c[k]), "output") for side, c in sides for k in range(n)]
        std = np.concatenate([swing.std for swing in self.swings])
        both = remembered(self.linearised)
        return least_squares(
            lambda x: both(x)[0], lambda x: both(x)[1], [*free, *linear], 1 / std, max_iterations=max_iterations,
            tolerance=1e-4,
        )  # fmt: skip

    def borders(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the rising and the falling border."""
        n = self.degree + 1
        return (theta[:n], theta[:n]) if self.static else (theta[:n], theta[n : 2 * n])

    def linearised(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return w − mean of all sines, and its derivatives."""
        n = self.degree + 1
        own = n if self.static else 2 * n
        rising, falling = self.borders(theta)
        gains = self.linear(theta[own:])
        residuals, rows = [], []
        power = np.arange(n)
        for k, swing in enumerate(self.swings):
            scale = (swing.amplitude * np.exp(gains.log_gain[k])) ** power
            w, by_angle, by_border = response(rising * scale, falling * scale, swing.angle + gains.phase[k], swing.touch)
            by_border = by_border * np.tile(scale, 2)
            by_gain = by_border @ np.concatenate([power * rising, power * falling])
            if self.static:
                by_border = by_border[:, :n] + by_border[:, n:]
            moved = np.outer(by_gain, gains.by_log_gain[k]) + np.outer(by_angle, gains.by_phase[k])
            residuals.append(w - swing.mean)
            rows.append(np.hstack([by_border, moved]))
        return np.concatenate(residuals), np.vstack(rows)

    def chi2(self, theta: Floats) -> Floats:
        """Return χ² of every sine."""
        n = self.degree + 1
        rising, falling = self.borders(theta)
        gains = self.linear(theta[n if self.static else 2 * n :])
        found = np.empty(len(self.swings))
        for k, swing in enumerate(self.swings):
            scale = (swing.amplitude * np.exp(gains.log_gain[k])) ** np.arange(n)
            w, *_ = response(rising * scale, falling * scale, swing.angle + gains.phase[k], swing.touch)
            found[k] = np.sum(((w - swing.mean) / swing.std) ** 2)
        return found


def free_gains(index: np.ndarray, count: int, reference: int) -> Callable[[Floats], Gains]:
    """Return G as a log gain, 0 at the reference, and a phase at each of `count` frequencies; index (R,) of every sine."""
    others = [j for j in range(count) if j != reference]
    gain_rows, phase_rows = np.zeros((count, 2 * count - 1)), np.zeros((count, 2 * count - 1))
    gain_rows[others, np.arange(count - 1)] = 1.0
    phase_rows[:, count - 1 :] = np.eye(count)

    def gains(theta: Floats) -> Gains:
        return Gains(gain_rows[index] @ theta, phase_rows[index] @ theta, gain_rows[index], phase_rows[index])

    return gains


def rational_gains(omega: Floats, zeros: int, poles: int, delay: bool) -> Callable[[Floats], Gains]:
    """Return G = (1 + b₁s + …)/(1 + a₁s + …)·e^{−s·delay} at every sine's ω (R,); θ = b, a, delay."""
    s = 1j * omega
    powers = s[:, None] ** np.arange(1, max(zeros, poles, 1) + 1)

    def gains(theta: Floats) -> Gains:
        b, a = theta[:zeros], theta[zeros : zeros + poles]
        top, bottom = 1 + powers[:, :zeros] @ b, 1 + powers[:, :poles] @ a
        g = top / bottom * (np.exp(-s * theta[-1]) if delay else 1.0)
        rates = np.hstack([powers[:, :zeros] / top[:, None], -powers[:, :poles] / bottom[:, None]])
        if delay:
            rates = np.column_stack([rates, -s])
        return Gains(np.log(np.abs(g)), np.angle(g), rates.real, rates.imag)

    return gains
