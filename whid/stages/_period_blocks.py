"""Harmonics of a periodic part of any length: block after block of whole periods, their power averaged."""

from __future__ import annotations

import numpy as np

from whid.signal import Floats
from whid.stages.periods import Harmonics, Spectrum, _window, of_lines, spectrum

BLOCK = 1 << 20  # samples at once: a part that is no longer gives the numbers of `harmonics`, digit for digit
_WHITE = np.empty(0)


class PeriodBlocks:
    """Takes the samples of a part in order, any number at a time, and holds one block of them.

    The blocks have equally many periods; what is left of the part, fewer periods than there are blocks, counts for the
    harmonics but not for their noise. The noise of a harmonic is that of the lines beside it, as in `harmonics`; a block's
    lines are wider. Raises `WhidError("stage-too-short")` below one period.
    """

    def __init__(self, length: int, period: float, skip: int, count: int, block: int = BLOCK) -> None:
        first, stop, self.periods = _window(length, period, skip)
        self.period, self.count = float(period), count
        blocks = max(1, min(int(np.ceil(self.periods * period / block)), self.periods // 2))
        self.each = self.periods // blocks  # periods
        edges = [first + round(k * self.each * period) for k in range(blocks + 1)]
        edges += [first + round(self.periods * period)] * (self.each * blocks < self.periods)
        self.edges = [min(edge, stop) for edge in edges]
        self.held: list[Floats] = []
        self.at = 0  # samples seen
        self.value = np.zeros(0, complex)
        self.power, self.noise = np.empty(0), 0.0
        self.blocks, self.valid = 0, 0
        self.kept: Spectrum | None = None

    def add(self, y: Floats) -> None:
        """Take the next samples, NaN where missing."""
        begin, end = self.at, self.at + len(y)
        while len(self.edges) > 1 and end >= self.edges[1]:
            self._hold(y, begin, self.edges[0], self.edges[1])
            self._block(np.concatenate(self.held), self.edges[0])
            self.held = []
            self.edges.pop(0)
        if len(self.edges) > 1:
            self._hold(y, begin, self.edges[0], end)
        self.at = end

    def _hold(self, y: Floats, begin: int, first: int, last: int) -> None:
        have = first + sum(map(len, self.held))
        if last > have:
            self.held.append(y[max(have - begin, 0) : last - begin].copy())

    def _block(self, window: Floats, start: int) -> None:
        found = spectrum(window, self.period, 0, self.count, start)
        share = found.window.periods / self.periods
        self.value = share * found.value + (self.value if len(self.value) else 0.0)
        if found.window.periods != self.each:
            return
        lines = min(len(found.power), len(self.power) or len(found.power))
        self.power = found.power[:lines] + (self.power[:lines] if len(self.power) else 0.0)
        self.noise += found.noise_std**2
        self.blocks, self.valid = self.blocks + 1, self.valid + found.window.valid
        self.kept = found

    def harmonics(self, ar: Floats = _WHITE) -> Harmonics:
        """Return the harmonics of the part, once it has been seen whole, with their errors for noise of a colour."""
        assert self.kept is not None
        if self.blocks == 1 and self.each == self.periods:
            return self.kept.harmonics(ar)
        window = self.kept.window._replace(valid=self.valid // self.blocks)
        one = of_lines(self.value, self.power / self.blocks, float(np.sqrt(self.noise / self.blocks)), window, ar)
        shrink = np.sqrt(self.each / self.periods)
        return one._replace(
            value_std=one.value_std * shrink, own_std=one.own_std * shrink, own_lines=one.own_lines * self.blocks,
            periods=self.periods,
        )  # fmt: skip
