"""A sine about an offset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, MinLen

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.signal import Floats

Positive = Annotated[float, Gt(0)]


@dataclass(frozen=True, kw_only=True)
class Sine(Part):
    """offset + amplitude·cos(ωt), a whole number of periods; several frequencies make several experiments.

    u(t) = offset + amplitude·cos(ωt + phase), ω = omega rad/s or 2π/(samples_per_period·dt). Exactly one of omega,
    samples_per_period, period (samples; of a sine found in a record, any real number). `lead_periods` come first and
    are not averaged: the transient. Raises `WhidError("part-parameters")` for two samples a period or fewer.
    Source [Brouri2019], eq. (3.16) with U·α = offset.

    >>> [part.period for part in Sine(offset=2, amplitude=1, samples_per_period=[600, 300], periods=20).expand(0.5)]
    [600.0, 300.0]
    """

    offset: float
    amplitude: Positive
    omega: Positive | Annotated[tuple[Positive, ...], MinLen(1)] | None = None
    samples_per_period: Positive | Annotated[tuple[Positive, ...], MinLen(1)] | None = None
    period: Positive | None = None
    periods: Annotated[int, Ge(1)] | None = None
    lead_periods: Annotated[int, Ge(0)] = 1
    phase: float = 0.0

    def __post_init__(self) -> None:
        if sum(x is not None for x in (self.omega, self.samples_per_period, self.period)) != 1:
            raise WhidError("block-parameters", "sine needs exactly one of omega, samples_per_period, period")
        if self.start is None and self.periods is None:
            raise WhidError("block-parameters", "a planned sine needs periods")

    def expand(self, dt: float) -> tuple[Part, ...]:
        """Return one experiment a frequency, its period in samples."""
        if self.period is not None:
            return (self,)
        given = self.samples_per_period if self.samples_per_period is not None else self.omega
        many = np.atleast_1d(np.asarray(given, float))
        periods = many if self.omega is None else 2 * np.pi / (many * dt)
        if self.start is None and (worst := float(periods.min())) <= 2:
            why = f": omega must lie below π/dt = {np.pi / dt:.4g} rad/s" if self.omega is not None else ""
            raise WhidError("part-parameters", f"{worst:.3g} samples a period, a sine needs more than 2{why}")
        return tuple(replace(self, period=float(p), omega=None, samples_per_period=None) for p in periods)

    def samples(self, dt: float) -> int:
        """Return lead and measured periods in samples."""
        if self.start is not None and self.stop is not None:
            return self.length
        return round(((self.periods or 0) + self.lead_periods) * float(self.period or 0))

    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return the sine."""
        return self.stretch(dt, rng)(0, self.samples(dt))

    def stretch(self, dt: float, rng: np.random.Generator) -> Callable[[int, int], Floats]:
        """Return any stretch of the sine."""

        def sine(first: int, last: int) -> Floats:
            n = np.arange(first, last)
            return np.asarray(self.offset + self.amplitude * np.cos(2 * np.pi * n / (self.period or np.inf) + self.phase))

        return sine

    def numbers(self, dt: float) -> int:
        """Return that none is kept."""
        return 0

    def radians(self, dt: float) -> float:
        """Return ω of an expanded part, rad/s."""
        return 2 * np.pi / ((self.period or np.inf) * dt)
