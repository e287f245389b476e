"""Blocks that do something of their own in time: w = v + c(t) or w = v·(1 + c(t)), t the record's own time."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks._block import Block, State, Tangents
from whid.blocks._split import pointwise, total
from whid.signal import Floats, Impulses, Panels, Signal, rule


@dataclass(frozen=True, kw_only=True)
class Clocked(Block):
    """A leaf gives the course c(t) and its derivatives. The steady state leaves it out."""

    scales: ClassVar[bool] = False  # the signal, instead of being added to it

    @abstractmethod
    def at(self, time: Floats, wrt: str = "") -> Floats:
        """Return c, or its derivative with respect to one of the block's numbers, at times in s (any shape)."""

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Add the course, or scale by it."""
        return self._passed(signal, signal), None

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Pass the seeds on; the block's own numbers by their derivatives."""
        along = [self._passed(seed, signal) if self.scales else seed for seed in seeds]
        rates = [self._course(signal, name) for name in wrt]
        if self.scales:
            rates = [pointwise(np.multiply, [signal, rate]) for rate in rates]
        return Tangents(self._passed(signal, signal), along + rates, None)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the level: before the record nothing has moved."""
        return level, None

    def _passed(self, signal: Signal, grid: Signal) -> Signal:
        course = self._course(grid, "")
        if not self.scales:
            return total([signal, course])
        return pointwise(lambda v, c: v * (1 + c), [signal, course], lambda courses: self._scaled(courses[0].impulses, grid))

    def _scaled(self, hits: Impulses, grid: Signal) -> Impulses:
        when = grid.t0 + grid.dt * (hits.interval + hits.at)
        return hits._replace(area=hits.area * (1 + self.at(np.asarray(when, float))))

    def _course(self, signal: Signal, wrt: str) -> Signal:
        time: Floats = np.asarray(signal.t0 + signal.dt * np.arange(len(signal.values)), np.float64)
        values = self.at(time, wrt)
        if signal.sampled:
            return signal.with_values(values)
        return signal.with_values(values, lambda: Panels(self._inside(time, signal, wrt)))

    def _inside(self, time: Floats, signal: Signal, wrt: str) -> Floats:
        """Return the course at the nodes of every interval."""
        return self.at(np.asarray(time + rule(signal.order).nodes[:, None] * signal.dt, np.float64), wrt)


@dataclass(frozen=True, kw_only=True)
class Switched(Clocked):
    """A course that changes once, at a sample: within an interval it is what it was at its start."""

    at_s: float
    height: float

    def at(self, time: Floats, wrt: str = "") -> Floats:
        """Return the height from `at_s` on, nothing before."""
        on = np.asarray(time >= self.at_s - 1e-12 * (1 + abs(self.at_s)), float)
        return on if wrt else self.height * on

    def _inside(self, time: Floats, signal: Signal, wrt: str) -> Floats:
        return np.broadcast_to(self.at(time, wrt), (signal.order, len(time)))
