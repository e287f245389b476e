"""Does a curve between sampled filters fold harmonics back that the plant does not have."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from whid.blocks.oversampled import NODES, finer
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats, held
from whid.stages._cascade import Cascade, Filter
from whid.stages.cascade_fit import Window

SURE = 5.0  # standard errors
FINER = 4  # times the cascade's rate: what stands for between its samples


class BetweenSamples(NamedTuple):
    """The aliasing that a model at the record's rate makes, regressed on what it leaves over: 1 where the plant has none."""

    coefficient: Annotated[float, Quantity("1", error="coefficient_std")]
    coefficient_std: float
    size: Annotated[float, Quantity("output")]  # rms of the aliasing
    left: Annotated[float, Quantity("output")]  # rms of the residual
    present: bool

    @property
    def share(self) -> float:
        """Return how much of the residual's rms would go with the aliasing."""
        return 1 - float(np.sqrt(max(1 - (self.size / self.left) ** 2, 0.0))) if self.present and self.left else 0.0

    def table(self) -> Table:
        """Return the coefficient and the verdict."""
        verdict = "oversample" if self.present else "the record's rate will do"
        row = (
            Measured(self.coefficient, self.coefficient_std),
            float(f"{self.size:.3g}"),
            float(f"{self.left:.3g}"),
            verdict,
        )
        columns = ("coefficient (1: as predicted)", "rms of the aliasing", "rms of the residual", "verdict")
        return Table("Between the samples", columns, (row,))


def between_samples(window: Window, cascade: Cascade, dt: float) -> BetweenSamples:
    """Predict the aliasing of a cascade at its own rate and look for it in the residual.

    At each curve a = f(v) − ⌊f(v↑)⌋, v↑ at four times the rate, ⌊·⌋ without what lies above half the cascade's rate; all of
    them through what comes behind: y − ŷ = −c·a + e. Harmonics of an analogue plant do not fold back: c = 1. Present: c is
    within ½ of 1 and five standard errors from 0. dt of the record; the window's input is at `factor` times its rate.
    """
    x, term = window.u, np.zeros(len(window.u))
    for part in cascade.parts:
        if isinstance(part, Filter):
            x, term = part.through(x), part.through(term)
        else:
            fine = part.value(finer(held(x, dt / window.factor, "bandlimited", order=NODES), FINER).values)
            x, term = part.value(x), part.derivative(x) * term + _thinned(fine, FINER) - part.value(x)
    term = term[:: window.factor][window.use]
    left = (window.y - x[:: window.factor])[window.use]
    power = float(term @ term)
    if power <= 1e-24 * float(left @ left) or not power:
        return BetweenSamples(0.0, float("inf"), 0.0, float(np.std(left)), False)
    coefficient = float(term @ left) / power
    std = float(np.std(left - coefficient * term) / np.sqrt(power))
    present = abs(coefficient - 1) < 0.5 and coefficient > SURE * std
    return BetweenSamples(coefficient, std, float(np.std(term)), float(np.std(left)), present)


def _thinned(fine: Floats, factor: int) -> Floats:
    """Return every factor-th sample of what lies below half the lower rate (mirrored, so that the ends do not ring)."""
    mirrored = np.concatenate([fine, fine[::-1]])
    spectrum = np.fft.rfft(mirrored)
    spectrum[len(mirrored) // (2 * factor) :] = 0
    return np.asarray(np.fft.irfft(spectrum, len(mirrored))[: len(fine) : factor])
