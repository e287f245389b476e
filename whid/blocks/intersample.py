"""What an input really does between its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from whid.blocks._block import Block, State, Tangents
from whid.signal import Signal, held


@dataclass(frozen=True, kw_only=True)
class Intersample(Block):
    """The same samples, with another course between them than the record declares.

    u(t_n) stays; between: zoh holds, foh joins by straight lines, bandlimited interpolates by sin(x)/x

    u ──►│ ⌐ → ╱ │──► u

    It stands first in a chain and needs the whole record at once. On the sampled path it does nothing. Where the record is
    declared rightly (`intersample:` of its data) nobody needs this block.

    >>> Intersample(between="foh").step(held(np.array([0.0, 1.0, 1.0]), 0.1, "zoh"))[0].panels.values[:, 0].round(2)
    array([0.07, 0.33, 0.67, 0.93])
    """

    whole: ClassVar[bool] = True
    between: Literal["zoh", "foh", "bandlimited"]

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Take the samples and join them anew."""
        return self._joined(signal), None

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Join the seeds' samples alike."""
        return Tangents(self._joined(signal), [self._joined(seed) for seed in seeds], None)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the level."""
        return level, None

    def _joined(self, signal: Signal) -> Signal:
        if signal.sampled:
            return signal
        return held(np.asarray(signal.values, float), signal.dt, self.between, signal.t0, signal.order)
