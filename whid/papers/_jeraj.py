"""What the exhibits of [Jeraj and Mathews] share: its records, the largest error on [−1, 1], power spectra."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from whid.blocks._static import Static
from whid.disturbances.white import White
from whid.methods.memoryless import Memoryless
from whid.papers._exhibit import Bench
from whid.signal import Floats
from whid.simulate import simulate
from whid.stages._chebyshev import Domain, basis

GRID = 401  # inputs, closest at the ends, at which the largest error is looked for
NOT_GIVEN = (
    "Not given in the paper: the size of the input, how a window grows, the filter, where the largest error is sought. "
    "Ours: standard deviation 1/3, half-width doubled until 15 samples are in, a sharp band, all of [-1, 1]. An input "
    "scaled to a largest value of 1, or a standard deviation of 0.45 and more, does not give the variances of Table 1."
)


class Trial(NamedTuple):
    """One record of the paper's experiment, and the size of its noise."""

    x: Floats
    y: Floats
    noise_std: float


def method(bench: Bench) -> tuple[Memoryless, Domain]:
    """Return the study's method and its domain."""
    found = cast(Memoryless, bench.method)
    return found, found.domain or (-1.0, 1.0)


def curve(bench: Bench) -> Static:
    """Return the plant's curve."""
    assert bench.plant is not None
    return cast(Static, bench.plant.chain[0])


def trials(bench: Bench, count: int, snr_db: float, key: int) -> Iterator[Trial]:
    """Yield records of the study at a signal-to-noise ratio (inf: no noise), each with draws of its own."""
    assert bench.plant is not None
    noise = _noise(snr_db)
    plant = replace(bench.plant, noise=(noise,))
    for k in range(count):
        record = simulate(plant, bench.experiments[0], bench.rng(key, k))
        yield Trial(record.u, record.y, noise.scale(curve(bench).value(record.u)))
        bench.watch(k + 1, count)


def disturbed(clean: Floats, snr_db: float, rng: np.random.Generator) -> Floats:
    """Return an output with noise of a signal-to-noise ratio."""
    noise = _noise(snr_db)
    return clean + noise.scale(clean) * noise.draw(len(clean), 1.0, rng) if np.isfinite(snr_db) else clean


def _noise(snr_db: float) -> White:
    return White(std=0.0) if np.isinf(snr_db) else White(snr_db=snr_db)


class Ruler(NamedTuple):
    """Chebyshev basis and true curve on a grid over the domain: the largest error of many estimates at once."""

    rows: Floats  # (K + 1, GRID)
    true: Floats

    @classmethod
    def of(cls, bench: Bench, order: int, domain: Domain) -> Ruler:
        """Return the ruler of a study."""
        t = np.cos(np.linspace(np.pi, 0, GRID))
        low, high = domain
        return cls(basis(t, order), curve(bench).value((low + high) / 2 + t * (high - low) / 2))

    def largest(self, coefficients: Floats) -> Floats:
        """Return max |p − g| of every row of coefficients (…, K + 1)."""
        return np.asarray(np.abs(coefficients @ self.rows - self.true).max(axis=-1))


def decibel(power: Any) -> Any:
    """Return 10 log₁₀."""
    return 10 * np.log10(power)


def spectrum(x: Floats) -> tuple[Floats, Floats]:
    """Return frequency over Nyquist, and power density in dB, of means over 1024 samples."""
    from scipy.signal import welch

    frequency, density = welch(x, fs=2.0, nperseg=1024, detrend=False)
    return frequency, decibel(np.maximum(density, 1e-40))
