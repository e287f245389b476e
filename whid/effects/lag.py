"""An extra pole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.linear import Linear
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)


@dataclass(frozen=True, kw_only=True)
class Lag(Effect):
    """An extra pole in front of the nonlinearity or behind it: G = 1/(τs + 1).

    Its signature is a phase that grows with frequency, ahead of the curve or behind it; a short one looks like a delay.
    """

    places: ClassVar[tuple[Place, ...]] = (
        "front",
        "back",
    )
    within: ClassVar[bool] = True

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield a lag of some samples, and of many."""
        place = sites.front if self.place == "front" else sites.back
        if place is None:
            return
        for samples in SAMPLES:
            block = Linear(num=(1.0,), den=(samples * look.records[0].dt, 1.0), fix=("num", "den.1"))
            yield sites.inserted(place, block, inside=True).candidate("den.0")
