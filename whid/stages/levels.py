"""Static curve: the mean output at every constant level of the input, with honest standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._noise import estimate_noise, quantisation_variance, quantum_of

SHOWN = 60  # visits in a table


class StaticCurve(NamedTuple):
    """Static curve: mean output at each level, in the order of the visits."""

    level: Annotated[Floats, Quantity("input", ("level",))]
    mean: Annotated[Floats, Quantity("output", ("level",), error="mean_std")]
    mean_std: Annotated[Floats, Quantity("output", ("level",))]
    direction: Annotated[Floats, Quantity("1", ("level",))]  # +1 reached from below, −1 from above, 0 neither
    samples: Annotated[NDArray[np.intp], Quantity("1", ("level",))]
    settle: Annotated[float, Quantity("s")]
    noise_std: Annotated[float, Quantity("output")]
    ar: Annotated[Floats, Quantity("1", ("lag",))]  # e(t) = Σ ar[k] e(t − 1 − k) + innovation
    long_run_variance: Annotated[float, Quantity("output²")]  # lim n·var(mean of n)
    equal_noise: bool  # False: every level has a noise variance of its own
    quantum: Annotated[float, Quantity("output")]  # step of a coarsely quantised output, 0 without
    drifting: Annotated[NDArray[np.bool_], Quantity("1", ("level",))]  # still moving, beyond noise: in the error

    def table(self) -> Table:
        """Return level, direction and mean, a row a visit; of very many the first, the rest are in the result."""
        way = {1: "up", -1: "down"}
        rows = tuple(
            (float(f"{u:.6g}"), way.get(int(d), ""), Measured(float(m), float(s)), int(n))
            for u, d, m, s, n in zip(self.level, self.direction, self.mean, self.mean_std, self.samples, strict=True)
        )
        more = len(rows) - SHOWN
        rest = [f"{more} more in result.h5, stages/static_curve"] if more > 0 else []
        order = f"AR({len(self.ar)})" if len(self.ar) else "white"
        notes = [*rest, f"noise std {self.noise_std:.3g}, {order}, long-run variance {self.long_run_variance:.3g}"]
        notes += [] if self.equal_noise else ["the noise differs between levels: each has its own variance"]
        notes += [f"output quantised in steps of {self.quantum:.3g}"] if self.quantum else []
        notes += [f"{self.drifting.sum()} of {len(self.level)} levels still drift: their errors include it"] * any(
            self.drifting
        )
        return Table("Static curve", ("level, input", "reached", "mean, output", "samples"), rows[:SHOWN], tuple(notes))


def level_means(
    holds: Sequence[Floats], level: Floats, direction: Floats, dt: float, settle: float, min_samples: int = 8
) -> StaticCurve:
    """Return the mean of what each hold measures after `settle` seconds, and its standard error.

    mean = Σ y/n over samples at settle ≤ t, var(mean) = (γ₀ + 2 Σ (1 − k/n) γₖ)/n with γ of one autoregression pooled over
    the holds (order by BIC, the bias of removing means and trends corrected); a hold keeps a noise variance of its own where
    the holds differ (Bartlett, p < 1e-4). An output quantised so coarsely that its noise cannot dither it keeps the
    rounding error, up to step/√12; a hold that still drifts, its halves differing beyond noise, has their
    difference in its error. holds: L arrays of output, NaN where missing; level (L,), direction (L,) ±1 or 0; dt,
    settle in s. A hold with fewer than min_samples valid samples left is dropped. Raises `WhidError("stage-too-short")`
    if none is left.
    Source [Brouri2019], eq. (3.13), corrected: the sum there has one sample too many.

    >>> holds = [2 + np.random.default_rng(k).normal(size=500) for k in range(5)]
    >>> curve = level_means(holds, np.arange(5.0), np.ones(5), dt=0.1, settle=10.0)
    >>> curve.samples, bool(np.all(np.abs(curve.mean - 2) < 3 * curve.mean_std)), curve.mean_std.round(2)
    (array([400, 400, 400, 400, 400]), True, array([0.05, 0.05, 0.05, 0.05, 0.05]))
    """
    first = first_settled(settle, dt)
    settled = [Held.of(np.asarray(hold[first:], float)) for hold in holds]
    return curve_of(settled, level, direction, settle, min_samples)


def first_settled(settle: float, dt: float) -> int:
    """Return the first sample that is at or after a settling time."""
    return int(np.ceil(settle / dt - 1e-9))


class Held(NamedTuple):
    """What is read of one hold, settled."""

    noise: Floats  # samples in a row that tell the noise: all of them, or where they are too many the first
    samples: int  # of it all, missing ones as well
    valid: int
    mean: float
    drift: float  # mean of the second half minus that of the first, NaN where a half is missing
    std: float | None  # of one sample; None: that of `noise`

    @classmethod
    def of(cls, y: Floats) -> Held:
        """Return it of samples that are all here."""
        half = len(y) // 2
        return cls(y, len(y), int(np.isfinite(y).sum()), _mean(y), _mean(y[half:]) - _mean(y[:half]), None)

    @property
    def spread(self) -> float:
        """Return the standard deviation of one sample."""
        return float(np.nanstd(self.noise, ddof=1)) if self.std is None else self.std


def curve_of(settled: Sequence[Held], level: Floats, direction: Floats, settle: float, min_samples: int = 8) -> StaticCurve:
    """Return the static curve of holds that have been read: `level_means` of any length."""
    kept = [h for h, hold in enumerate(settled) if hold.valid >= min_samples]
    if not kept:
        raise WhidError("stage-too-short", f"no hold has {min_samples} samples left after a settling time of {settle:.4g} s")
    settled = [settled[h] for h in kept]
    count, samples = np.array([hold.valid for hold in settled]), np.array([hold.samples for hold in settled])
    noise = estimate_noise([hold.noise for hold in settled], degree=1)
    variance = np.where(count == samples, noise.variance_of_mean(count), 0.0)
    for h in np.flatnonzero(count != samples):
        there = np.isfinite(settled[h].noise)
        variance[h] = noise.variance_of_masked_mean(there) * there.sum() / count[h]
    quantum = quantum_of(np.concatenate([hold.noise for hold in settled]))
    drift = np.nan_to_num(np.array([hold.drift for hold in settled]))
    drift_variance = 2 * noise.variance_of_mean(np.maximum(count // 2, 1)) * noise.scale
    drifting = _drifting(drift**2, drift_variance)
    coarse: float | Floats = 0.0
    if quantum:
        coarse = quantisation_variance(np.array([hold.spread for hold in settled]), quantum)
    std = np.sqrt(variance * noise.scale + coarse + np.where(drifting, drift**2, 0.0))
    return StaticCurve(
        np.asarray(level, float)[kept],
        np.array([hold.mean for hold in settled]),
        std,
        np.asarray(direction, float)[kept],
        count,
        settle,
        float(np.sqrt(noise.autocovariance[0])),
        noise.ar,
        noise.long_run_variance,
        bool(np.all(noise.scale == 1)),
        quantum,
        drifting,
    )


def _drifting(square: Floats, variance: Floats) -> NDArray[np.bool_]:
    """Return which holds drift: beyond 4 standard errors, or all above 1 when the holds together do (χ², p < 1e-4)."""
    from scipy.special import chdtrc

    variance = np.maximum(variance, 1e-300)
    together = chdtrc(len(square), np.sum(square / variance)) < 1e-4
    return np.asarray(square > (1 if together else 16) * variance)


def _mean(y: Floats) -> float:
    """Return the mean of what is there, NaN where nothing is."""
    mean = float(y.mean()) if len(y) else float("nan")
    if np.isfinite(mean):
        return mean
    there = y[np.isfinite(y)]
    return float(there.mean()) if len(there) else float("nan")
