"""Gaussian noise in a frequency band."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.signal import Floats

Share = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True, kw_only=True)
class NoiseBand(Part):
    """Gaussian noise, flat within a band and nothing outside, periodic over its length.

    u = offset + std·e, e with a flat spectrum on [low, high]·Nyquist; std is the ensemble's. Raises
    `WhidError("part-parameters")` for a band without a frequency line. Source [Jeraj and Mathews], section 4.

    >>> NoiseBand(band=(0.39, 0.59), std=0.5, duration_s=1000).input(0.1, np.random.default_rng(0)).shape
    (10000,)
    """

    band: tuple[Share, Share] = (0.0, 1.0)
    std: Annotated[float, Gt(0)] = 1.0
    offset: float = 0.0
    duration_s: Annotated[float, Gt(0)] | None = None

    def __post_init__(self) -> None:
        if self.band[0] >= self.band[1]:
            raise WhidError("part-parameters", f"band is [low, high], not {list(self.band)}")
        if self.start is None and self.duration_s is None:
            raise WhidError("part-parameters", "a planned noise_band needs duration_s")

    def samples(self, dt: float) -> int:
        """Return duration_s in samples, or the length of the stretch found in a record."""
        return self.length if self.duration_s is None else max(1, round(self.duration_s / dt))

    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return the noise: independent complex Gaussian lines inside the band, none at zero and Nyquist."""
        n = self.samples(dt)
        k = np.arange(1, (n - 1) // 2 + 1)
        lines = k[(k >= self.band[0] * n / 2) & (k <= self.band[1] * n / 2)]
        if not len(lines):
            raise WhidError("part-parameters", f"no frequency line of {n} samples lies in the band {list(self.band)}")
        spectrum = np.zeros(n // 2 + 1, complex)
        spectrum[lines] = rng.standard_normal(len(lines)) + 1j * rng.standard_normal(len(lines))
        size = self.std * n / (2 * np.sqrt(len(lines)))
        return np.asarray(self.offset + size * np.fft.irfft(spectrum, n), np.float64)
