"""A multisine with random phases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.signal import Floats, Ints

Share = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True, kw_only=True)
class Multisine(Part):
    """A sum of harmonics of one period with equal amplitudes and random phases.

    u_n = offset + rms·√(2/K) Σ_k cos(2π k n/period + φ_k), φ_k uniform, over K lines k

    period in samples; either `lines`, the harmonics themselves, or `band`, [low, high] as shares of the Nyquist
    frequency, with `odd` only the odd ones. lead_periods come first and are not averaged. Raises
    `WhidError("part-parameters")` for both or neither, no line, or a line at or above the Nyquist frequency.
    Source [Pintelon and Schoukens 2012, System Identification], section 2.3.

    >>> part = Multisine(period=64, periods=2, band=(0.0, 0.2), odd=True, rms=0.5)
    >>> part.harmonics().tolist(), round(float(np.std(part.input(0.1, np.random.default_rng(0)))), 12)
    ([1, 3, 5], 0.5)
    """

    period: Annotated[int, Ge(4)]
    periods: Annotated[int, Ge(1)] | None = None
    lead_periods: Annotated[int, Ge(0)] = 1
    rms: Annotated[float, Gt(0)] = 1.0
    offset: float = 0.0
    lines: Annotated[tuple[Annotated[int, Ge(1)], ...], MinLen(1)] | None = None
    band: tuple[Share, Share] | None = None
    odd: bool = False

    def __post_init__(self) -> None:
        if self.start is not None:
            return
        if self.periods is None:
            raise WhidError("part-parameters", "a planned multisine needs periods")
        if (self.lines is None) == (self.band is None):
            raise WhidError("part-parameters", "multisine needs exactly one of lines, band")
        lines = self.harmonics()
        if not len(lines) or lines.max() >= self.period / 2 or lines.min() < 1:
            raise WhidError(
                "part-parameters", f"multisine needs lines between 1 and {(self.period - 1) // 2}: {lines.tolist()}"
            )

    def harmonics(self) -> Ints:
        """Return the excited harmonics of the period."""
        if self.lines is not None:
            return np.array(self.lines)
        low, high = self.band or (0.0, 1.0)
        k = np.arange(1, (self.period - 1) // 2 + 1)
        inside = (k >= low * self.period / 2) & (k <= high * self.period / 2)
        return np.asarray(k[inside & ((k % 2 == 1) | (not self.odd))])

    def samples(self, dt: float) -> int:
        """Return lead and measured periods in samples."""
        return self.length if self.periods is None else (self.periods + self.lead_periods) * self.period

    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return the multisine."""
        return self.stretch(dt, rng)(0, self.samples(dt))

    def stretch(self, dt: float, rng: np.random.Generator) -> Callable[[int, int], Floats]:
        """Return any stretch of the multisine, phases drawn once for all periods."""
        lines = self.harmonics()
        spectrum = np.zeros(self.period // 2 + 1, complex)
        spectrum[lines] = self.period / 2 * np.exp(2j * np.pi * rng.random(len(lines)))
        wave = self.offset + self.rms * np.sqrt(2 / len(lines)) * np.fft.irfft(spectrum, self.period)

        def multisine(first: int, last: int) -> Floats:
            phase, count = first % self.period, last - first
            return wave[phase : phase + count] if phase + count <= self.period else np.resize(np.roll(wave, -phase), count)

        return multisine

    def numbers(self, dt: float) -> int:
        """Return the samples of a period, and what its transform needs."""
        return 6 * self.period
