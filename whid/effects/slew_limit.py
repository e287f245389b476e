"""An actuator that cannot follow fast."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.slew_limit import SlewLimit as SlewLimit_
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (0.9, 1.4, 2.1, 3.1, 4.7, 7.0, 10.5, 16.0)  # that the largest change of the input takes


@dataclass(frozen=True, kw_only=True)
class SlewLimit(Effect):
    """The input moves at most so much a second: |dw/dt| ≤ rate.

    Its signature follows the large changes of the input only; up and down branches part.
    """

    places: ClassVar[tuple[Place, ...]] = ("input",)
    within: ClassVar[bool] = True

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield rates from the largest change a sample downwards."""
        u = np.concatenate([np.abs(np.diff(r.u)) for r in look.records])
        moves = u[u > 0]
        if not len(moves):
            return
        dt = look.records[0].dt
        for samples in SAMPLES:
            rate = float(moves.max()) / (samples * dt)
            yield sites.inserted(0, SlewLimit_(rate=rate)).candidate("rate")
