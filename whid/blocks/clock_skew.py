"""Two clocks that do not run alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from whid.blocks._block import Block, Free, State, Tangents
from whid.blocks._split import value_at
from whid.blocks.delay import _slopes
from whid.signal import Floats, Signal


@dataclass(frozen=True, kw_only=True)
class ClockSkew(Block):
    """The same signal, read by a clock that runs fast or slow: a lag that grows with time.

    w(t) = v(t + skew·t), t the record's own time

    v ──►│ t·(1 + skew) │──► w

    skew relative, 1e-6 is a part in a million; positive reads ahead. It needs the whole record at once, stands behind all
    dynamics (what comes out counts at its samples), and beyond either end of the record the last value is held. On the
    sampled path v is taken to be straight between its samples.

    >>> ClockSkew(skew=-0.5)([0.0, 2.0, 4.0, 6.0], dt=1.0, between="discrete")
    array([0., 1., 2., 3.])
    """

    whole: ClassVar[bool] = True
    skew: Annotated[float, Free("1", -0.5, 0.5)]

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Read the signal at the other clock's times."""
        return self._read(signal, signal), None

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Read the seeds alike; with respect to the skew it is t·dv/dt at the place read."""
        time = signal.t0 + signal.dt * np.arange(len(signal.values))
        rates = [self._out(signal, time * self._slope(signal)) for _ in wrt]
        return Tangents(self._read(signal, signal), [self._read(seed, signal) for seed in seeds] + rates, None)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the level: it has been there for ever."""
        return level, None

    def _where(self, signal: Signal) -> tuple[np.ndarray, Floats]:
        """Return the interval that is read and the place in it, in [0, 1)."""
        time = signal.t0 + signal.dt * np.arange(len(signal.values))
        place = np.clip((time * (1 + self.skew) - signal.t0) / signal.dt, 0.0, max(len(time) - 1, 0))
        index = np.floor(place + 1e-9).astype(np.intp)
        return index, np.maximum(place - index, 0.0)

    def _read(self, v: Signal, grid: Signal) -> Signal:
        index, share = self._where(grid)
        if callable(v.between):
            return self._out(grid, value_at(v.panels, index, share))
        after = v.values[..., np.minimum(index + 1, len(grid.values) - 1)]
        here = v.values[..., index]
        return self._out(grid, here + share * (after - here) if v.sampled else here)

    def _slope(self, v: Signal) -> Floats:
        index, share = self._where(v)
        if callable(v.between):
            return -value_at(_slopes(v.panels, v.dt), index, share)
        after = v.values[np.minimum(index + 1, len(v.values) - 1)]
        return np.asarray((after - v.values[index]) / v.dt) if v.sampled else np.zeros(len(v.values))

    def _out(self, grid: Signal, values: Floats) -> Signal:
        return grid.with_values(values, "discrete" if grid.sampled else "zoh")
