"""How long a hold takes to settle, from the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.quantity import Quantity, Table
from whid.signal import Floats, Ints
from whid.stages._noise import estimate_noise


class Settle(NamedTuple):
    """Settling time: what to leave out at the start of every hold."""

    settle: Annotated[float, Quantity("s")]  # margin × truncation
    truncation: Annotated[float, Quantity("s")]  # the shortest that leaves no drift to be seen
    statistic: float  # χ² of the drift that is left at the truncation
    dof: int
    p: float
    reached: bool  # False: the holds are too short, settle is three quarters of the shortest
    bias: Annotated[float, Quantity("output")] = 0.0  # that the drift leaves in the levels, rms, as its decay foretells
    bias_ratio: float = 0.0  # over the standard error of a level

    def table(self) -> Table:
        """Return one row, and a warning where the holds are too short."""
        warn = () if self.reached else (f"not reached: {self.drift()}",)
        row = (round(self.settle, 4), round(self.truncation, 4), round(self.statistic, 2), self.dof, float(f"{self.p:.3g}"))
        return Table("Settling time", ("settle s", "truncation s", "χ²", "dof", "p"), (row,), warn)

    def drift(self) -> str:
        """Return what is left of the drift, in words."""
        if not np.isfinite(self.bias):
            return "the output drifts through the holds and does not slow down; hold longer"
        size = f"{self.bias:.2g}, {self.bias_ratio:.2g} standard errors of a level"
        return f"the output still drifts where the holds end, by about {size}; hold longer"


def settle_time(holds: Sequence[Floats], dt: float, significance: float = 0.01, margin: float = 1.5) -> Settle:
    """Return the shortest truncation after which the holds show no drift, times a margin.

    χ²(τ) = Σ (mean of the first quarter − mean of the last half)²/variance over the holds, each from τ on; the first τ,
    up to half the shortest hold, with p(χ², H) ≥ significance, and a tenth of it from there to margin·τ: a drift that swings
    is nought now and then. The variances are those of the noise in the last halves: an autoregression, quadratic trends
    removed, so that a drift is not taken for noise. Where none passes, what the drift leaves in the last quarters is
    foretold from how the means m of the quarters 2, 3, 4 close up: of an exponential it is (m₃ − m₄)ρ/(1 − ρ) with
    ρ = (m₃ − m₄)/(m₂ − m₃); half a standard error of these means is as good as settled. holds: output samples from each
    change of level on, NaN where missing; dt and the result in s. Holds shorter than half the median are left out.
    Raises `WhidError("stage-too-short")` without a hold of 16 samples. Source [Brouri2019], the t_r of eq. (3.9).

    >>> t = np.arange(400)
    >>> noise = np.random.default_rng(1).normal(size=(8, 400))
    >>> round(settle_time(list(noise + 50 * np.exp(-t / 20)), 0.1).settle, 1)
    15.9
    """
    length = np.array([len(hold) for hold in holds])
    used = [holds[k] for k in used_of(length)]
    sums = [Cumulated.of(hold) for hold in used]
    scale = float(np.nanmax(np.abs(np.concatenate(used)))) if used else 0.0
    return settle_of(sums, [hold[len(hold) // 2 :] for hold in used], scale, dt, significance, margin)


def used_of(length: Ints) -> Ints:
    """Return which holds, by their lengths, count: 16 samples or more, half the median or more."""
    if not len(length) or length.max() < 16:
        raise WhidError("stage-too-short", "no hold has 16 samples or more")
    return np.flatnonzero(length >= max(16, np.median(length) / 2))


class Cumulated(NamedTuple):
    """Sums of a hold from its first sample to each of some places, about a base that keeps them small."""

    length: int
    base: float
    total: Floats  # at all places, or at `places`
    seen: Ints
    places: Ints | None = None

    @classmethod
    def of(cls, hold: Floats) -> Cumulated:
        """Return them at all places of a hold that is all here."""
        valid = np.isfinite(hold)
        base = float(np.mean(hold[valid])) if valid.any() else 0.0
        total = np.append(0.0, np.cumsum(np.where(valid, hold - base, 0.0)))
        return cls(len(hold), base, total, np.append(0, np.cumsum(valid)))

    def mean(self, start: Ints, stop: Ints) -> tuple[Floats, Ints]:
        """Return the means of samples start … stop − 1, and their valid counts."""
        if self.places is not None:
            start, stop = np.searchsorted(self.places, start), np.searchsorted(self.places, stop)
        count = self.seen[stop] - self.seen[start]
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.base + (self.total[stop] - self.total[start]) / count, count


class Cuts(NamedTuple):
    """Where the means of holds begin and end: of the early quarter and of the late half behind every cut."""

    cut: Ints  # (cuts, 1)
    first: Ints  # (cuts, holds)
    half: Ints
    quarter: Ints  # (4, holds): the ends of the first quarter to the last

    def places(self, hold: int) -> Ints:
        """Return every place of a hold where a mean begins or ends."""
        return np.concatenate([self.cut[:, 0], self.first[:, hold], self.half[:, hold], self.quarter[:, hold]])


def cuts_of(length: Ints) -> Cuts:
    """Return the cuts of holds of given lengths: up to half the shortest."""
    cut = np.arange(int(length.min()) // 2 + 1)[:, None]
    cut = cut[:: max(1, len(cut) // 500)]
    quarter = np.arange(1, 5)[:, None] * length // 4
    return Cuts(cut, cut + (length - cut) // 4, length - (length - cut) // 2, quarter)


def settle_of(
    holds: Sequence[Cumulated], late_halves: Sequence[Floats], scale: float, dt: float, significance: float = 0.01,
    margin: float = 1.5,
) -> Settle:  # fmt: skip
    """Return the settling time of holds that have been read; late_halves: samples that tell the noise, all or the first."""
    from scipy.special import chdtrc

    n = np.array([hold.length for hold in holds])
    cut, first, half, quarter = cuts_of(n)
    noise = estimate_noise(late_halves, degree=2)
    starts = np.broadcast_to(cut, first.shape)
    pairs = [hold.mean(starts[:, h], first[:, h]) for h, hold in enumerate(holds)]
    early, early_count = (np.stack(column, axis=1) for column in zip(*pairs, strict=True))
    pairs = [hold.mean(half[:, h], np.full(len(cut), n[h])) for h, hold in enumerate(holds)]
    late, late_count = (np.stack(column, axis=1) for column in zip(*pairs, strict=True))
    early_count, late_count = np.maximum(early_count, 1), np.maximum(late_count, 1)
    variance = noise.scale * (noise.variance_of_mean(early_count) + noise.variance_of_mean(late_count))
    variance = np.maximum(variance, (1e-9 * max(scale, 1e-300)) ** 2)  # noise-free data settle to nine digits
    statistic = np.nansum((early - late) ** 2 / variance, axis=1)
    dof = np.isfinite(early - late).sum(axis=1)
    p = chdtrc(dof, statistic)
    stop = np.searchsorted(cut[:, 0], margin * cut[:, 0], side="right")
    lasting = [p[i:j].min(initial=1.0) >= significance / 10 for i, j in enumerate(stop)]
    passed = np.flatnonzero((p >= significance) & lasting)
    at = int(passed[0]) if len(passed) else len(cut) - 1
    truncation = float(cut[at, 0]) * dt
    found = Settle(margin * truncation, truncation, float(statistic[at]), int(dof[at]), float(p[at]), bool(len(passed)))
    if found.reached:
        return found
    means = np.stack([hold.mean(quarter[:-1, h], quarter[1:, h])[0] for h, hold in enumerate(holds)], axis=1)
    noise = estimate_noise([half[len(half) // 2 :] for half in late_halves], degree=2)  # less of the drift in it
    std = float(np.sqrt(np.nanmean(noise.scale * noise.variance_of_mean(quarter[3] - quarter[2]))))
    bias = foretold(means)
    return found._replace(reached=bool(bias <= std / 2), bias=bias, bias_ratio=bias / max(std, 1e-300))


def foretold(means: Floats) -> float:
    """Return the rms, over holds, of what an exponential drift leaves in the last of three equal stretches' means.

    means (3, holds); infinite where the drift does not slow down.

    >>> round(foretold(np.array([[8.0], [4.0], [2.0]])), 6)
    2.0
    """
    before, after = np.diff(means, axis=0)
    use = np.isfinite(before) & np.isfinite(after)
    before, after = before[use], after[use]
    rho = float(before @ after) / max(float(before @ before), 1e-300)
    size = float(np.sqrt(np.mean(before**2))) if len(before) else np.inf
    return size * rho**2 / (1 - rho) if rho < 1 else np.inf
