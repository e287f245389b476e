"""How much of a residual is white, and from which frequency down more than that is left: drift, or what a model lacks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Quantity, Table
from whid.signal import Floats, rms

LONGEST = 4096  # samples of a spectrum's window
TWICE = 2.0  # times the floor's density: what counts as more


class NoiseFloor(NamedTuple):
    """A residual split into its white floor and the rest."""

    rms: Annotated[float, Quantity("output")]
    floor: Annotated[float, Quantity("output")]  # of white noise with the mean density of the upper half of the band
    excess: Annotated[float, Quantity("output")]  # √(rms² − floor²), 0 where there is none
    below: Annotated[float, Quantity("rad/s")]  # the frequency under which the density is twice the floor's, 0 without
    quietest: Annotated[float, Quantity("output")]  # rms of the quietest and of the loudest tenth of the samples in a row
    loudest: Annotated[float, Quantity("output")]

    def table(self) -> Table:
        """Return one row."""
        row = tuple(float(f"{x:.4g}") for x in (*self[:3], self.below / (2 * np.pi), *self[4:]))
        columns = ("rms", "white floor", "above it", "below Hz", "quietest tenth", "loudest tenth")
        return Table("Noise floor", columns, (row,))


def noise_floor(residuals: Sequence[Floats], dt: float) -> NoiseFloor:
    """Return the floor of residuals without gaps, (N,) each, from their mean periodogram (Hann windows).

    >>> found = noise_floor([np.random.default_rng(0).standard_normal(20000)], 1.0)
    >>> abs(found.floor - 1) < 0.02, found.excess < 0.1
    (True, True)
    """
    from scipy.signal import welch

    longest = max(residuals, key=len)
    size = rms(np.concatenate(residuals))
    frequency, density = welch(longest, 1 / dt, nperseg=min(LONGEST, len(longest)), detrend="constant")
    level = float(np.mean(density[len(density) // 2 : -1]))
    above = density[1:] > TWICE * level
    last = int(np.argmin(above)) if not above.all() else len(above)
    floor = min(float(np.sqrt(level / (2 * dt))), size)
    tenths = [rms(part) for part in np.array_split(longest, 10)]
    return NoiseFloor(
        size, floor, float(np.sqrt(size**2 - floor**2)), 2 * np.pi * float(frequency[last]) * bool(last),
        min(tenths), max(tenths),
    )  # fmt: skip
