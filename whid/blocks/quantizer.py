"""Quantizer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt

from whid.blocks._block import Free
from whid.blocks._split import Crossings, split
from whid.blocks._static import Static
from whid.signal import Floats, Ints, Panels, Signal


@dataclass(frozen=True, kw_only=True)
class Quantizer(Static):
    """An analogue-to-digital converter: the nearest multiple of a step, or the next one below.

    w = step·⌊v/step + ½⌋ (mode: round) or step·⌊v/step⌋ (mode: floor)

          w     ┌──
          │  ┌──┘
    ──────┼──┘─────► v
       ───┘

    step > 0, in input units (`step_` from Python); as many levels as the signal needs, so `breakpoints` names none.

    >>> Quantizer(step_=0.5)([0.2, 0.3, -0.3], dt=1.0)
    array([ 0. ,  0.5, -0.5])
    """

    step_: Annotated[float, Free("input", 0.0), Gt(0)]
    mode: Literal["round", "floor"] = "round"

    def value(self, v: Floats) -> Floats:
        """Return the multiple of the step."""
        return np.asarray(self.step_ * self._level(v))

    def derivative(self, v: Floats) -> Floats:
        """Return 0."""
        return np.zeros(np.shape(v))

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the number of steps."""
        return self._level(v)

    def _course(self, signal: Signal, periodic: bool) -> tuple[Panels, Crossings]:
        """Split at the borders that the signal reaches; border k, between w = (k − 1)·step and k·step, is number k."""
        v = signal.panels
        nodes = np.concatenate([v.values.ravel(), v.splits.values.ravel()])
        low, high = nodes.min(initial=0.0), nodes.max(initial=0.0)
        margin = (high - low) / 2
        first, last = self._level(np.array([low - margin, high + margin]))
        k = np.arange(int(first), int(last) + 2)
        panels, crossings = split(signal, np.asarray((k - self._shift) * self.step_, np.float64), periodic)
        return panels, crossings._replace(which=crossings.which + int(k[0]))

    def _jumps_at(self, which: Ints) -> Floats:
        return np.full(len(which), self.step_)

    def _rates_at(self, which: Ints, name: str) -> Floats:
        return np.asarray(which - self._shift, np.float64)

    def _level(self, v: Floats) -> Floats:
        return np.asarray(np.floor(v / self.step_ + self._shift))

    @property
    def _shift(self) -> float:
        return 0.5 if self.mode == "round" else 0.0
