"""How long a hold takes to settle, from the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages._noise import estimate_noise


class Settle(NamedTuple):
    """Settling time: what to leave out at the start of every hold."""

    settle: Annotated[float, Quantity("s")]  # margin × truncation
    truncation: Annotated[float, Quantity("s")]  # the shortest that leaves no drift to be seen
    statistic: float  # χ² of the drift that is left at the truncation
    dof: int
    p: float
    reached: bool  # False: the holds are too short, settle is three quarters of the shortest

    def table(self) -> Table:
        """Return one row, and a warning where the holds are too short."""
        warn = () if self.reached else ("not reached: the output still drifts in the second half of the holds; hold longer",)
        row = (round(self.settle, 4), round(self.truncation, 4), round(self.statistic, 2), self.dof, float(f"{self.p:.3g}"))
        return Table("Settling time", ("settle s", "truncation s", "χ²", "dof", "p"), (row,), warn)


def settle_time(holds: Sequence[Floats], dt: float, significance: float = 0.01, margin: float = 1.5) -> Settle:
    """Return the shortest truncation after which the holds show no drift, times a margin.

    χ²(τ) = Σ (mean of the first quarter − mean of the last half)²/variance over the holds, each from τ on; the first τ,
    up to half the shortest hold, with p(χ², H) ≥ significance, and a tenth of it from there to margin·τ: a drift that swings
    is nought now and then. The variances are those of the noise in the last halves:
    an autoregression, quadratic trends removed, so that a drift is not taken for noise. holds: output samples from each
    change of level on, NaN where missing; dt and the result in s. Holds shorter than half the median are left out.
    Raises `WhidError("stage-too-short")` without a hold of 16 samples. Source [Brouri2019], the t_r of eq. (3.9).

    >>> t = np.arange(400)
    >>> noise = np.random.default_rng(1).normal(size=(8, 400))
    >>> round(settle_time(list(noise + 50 * np.exp(-t / 20)), 0.1).settle, 1)
    15.9
    """
    from scipy.special import chdtrc

    length = np.array([len(hold) for hold in holds])
    used = [hold for hold in holds if len(hold) >= max(16, np.median(length) / 2)]
    if not used:
        raise WhidError("stage-too-short", "no hold has 16 samples or more")
    noise = estimate_noise([hold[len(hold) // 2 :] for hold in used], degree=2)
    cut = np.arange(min(map(len, used)) // 2 + 1)[:, None]
    cut = cut[:: max(1, len(cut) // 500)]
    n = np.array([len(hold) for hold in used])
    first = cut + (n - cut) // 4
    half = n - (n - cut) // 2
    early, early_count = _means(used, np.broadcast_to(cut, first.shape), first)
    late, late_count = _means(used, half, np.broadcast_to(n, half.shape))
    variance = noise.scale * (noise.variance_of_mean(early_count) + noise.variance_of_mean(late_count))
    scale = max(float(np.nanmax(np.abs(np.concatenate(used)))), 1e-300)
    variance = np.maximum(variance, (1e-9 * scale) ** 2)  # noise-free data settle to nine digits
    statistic = np.nansum((early - late) ** 2 / variance, axis=1)
    dof = np.isfinite(early - late).sum(axis=1)
    p = chdtrc(dof, statistic)
    stop = np.searchsorted(cut[:, 0], margin * cut[:, 0], side="right")
    lasting = [p[i:j].min(initial=1.0) >= significance / 10 for i, j in enumerate(stop)]
    passed = np.flatnonzero((p >= significance) & lasting)
    at = int(passed[0]) if len(passed) else len(cut) - 1
    truncation = float(cut[at, 0]) * dt
    return Settle(margin * truncation, truncation, float(statistic[at]), int(dof[at]), float(p[at]), bool(len(passed)))


def _means(holds: Sequence[Floats], start: np.ndarray, stop: np.ndarray) -> tuple[Floats, np.ndarray]:
    """Return the means of samples start … stop − 1 of each hold (cuts, holds), and their valid counts (at least 1)."""
    mean, count = np.empty(start.shape), np.empty(start.shape, np.intp)
    for h, hold in enumerate(holds):
        valid = np.isfinite(hold)
        base = np.mean(hold[valid]) if valid.any() else 0.0
        total = np.append(0.0, np.cumsum(np.where(valid, hold - base, 0.0)))
        seen = np.append(0, np.cumsum(valid))
        count[:, h] = seen[stop[:, h]] - seen[start[:, h]]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean[:, h] = base + (total[stop[:, h]] - total[start[:, h]]) / count[:, h]
    return mean, np.maximum(count, 1)
