"""A hold of any length, read once: sums between places that are known ahead, and some samples for the noise."""

from __future__ import annotations

import numpy as np

from whid.signal import Floats, Ints, Spread
from whid.stages.levels import Held
from whid.stages.settle import Cumulated


class HoldSums:
    """Takes the samples of a hold in order, any number at a time.

    length   samples of the hold
    places   where sums are wanted, from 0 to length
    settled  the first sample that counts for the level, and for its noise
    kept     how many samples from there on are kept
    """

    def __init__(self, length: int, places: Ints, settled: int, kept: int) -> None:
        half = settled + (length - settled) // 2
        self.length, self.settled, self.kept = length, min(settled, length), kept
        self.places = np.unique(np.concatenate([places, [0, self.settled, min(half, length), length]]))
        self.half = min(half, length)
        self.total, self.seen = np.zeros(len(self.places)), np.zeros(len(self.places), np.intp)  # between two places
        self.base, self.at, self.largest = float("nan"), 0, 0.0
        self.noise: list[Floats] = []
        self.spread = Spread()

    def add(self, y: Floats) -> None:
        """Take the next samples, NaN where missing."""
        begin, end = self.at, self.at + len(y)
        self.at = end
        valid = np.isfinite(y)
        if not len(y):
            return
        if np.isnan(self.base) and valid.any():
            self.base = float(y[valid].mean())
        away = np.where(valid, y - self.base, 0.0)
        number = np.searchsorted(self.places, begin, side="right")
        inner = self.places[number : np.searchsorted(self.places, end, side="left")] - begin
        starts = np.append(0, inner).astype(np.intp)
        into = slice(number, number + len(starts))
        self.total[into] += np.add.reduceat(away, starts)
        self.seen[into] += np.add.reduceat(valid.astype(np.intp), starts)
        if valid.any():
            self.largest = max(self.largest, float(np.abs(y[valid]).max()))
        if end > self.settled:
            after = y[max(self.settled - begin, 0) :]
            self.spread = self.spread.joined(Spread.of(after[np.isfinite(after)]))
            if (missing := self.kept - sum(map(len, self.noise))) > 0:
                self.noise.append(after[:missing].copy())

    def head(self) -> Floats:
        """Return the settled samples that were kept."""
        return np.concatenate(self.noise) if self.noise else np.empty(0)

    def cumulated(self) -> Cumulated:
        """Return the sums from the first sample on."""
        base = 0.0 if np.isnan(self.base) else self.base
        return Cumulated(self.length, base, np.cumsum(self.total), np.cumsum(self.seen), self.places)

    def held(self) -> Held:
        """Return the level."""
        sums = self.cumulated()
        edges = np.array([self.settled, self.half, self.length])
        (first, late), _ = sums.mean(edges[:2], edges[1:])
        (mean,), (valid,) = sums.mean(edges[:1], edges[2:])
        std = float(np.sqrt(self.spread.squares / (self.spread.size - 1))) if self.spread.size > 1 else float("nan")
        return Held(self.head(), self.length - self.settled, int(valid), float(mean), float(late - first), std)
