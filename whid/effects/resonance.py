"""A lightly damped pair of poles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.linear import Linear
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (0.4, 0.55, 0.75, 1.0, 1.4, 1.9, 2.6, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0)  # a radian takes


@dataclass(frozen=True, kw_only=True)
class Resonance(Effect):
    """A lightly damped pair in front of the nonlinearity or behind it: G = 1/(s²/ω² + 2ζs/ω + 1).

    Its signature is a peak in frequency, and ringing after steps.
    """

    places: ClassVar[tuple[Place, ...]] = (
        "front",
        "back",
    )
    within: ClassVar[bool] = True

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield pairs over the band of the record, at two dampings."""
        place = sites.front if self.place == "front" else sites.back
        if place is None:
            return
        dt = look.records[0].dt
        for samples in SAMPLES:
            for zeta in (0.05, 0.15):
                w = 1 / (samples * dt)
                block = Linear(num=(1.0,), den=(w**-2, 2 * zeta / w, 1.0), fix=("num", "den.2"))
                yield sites.inserted(place, block, inside=True).candidate("den.0", "den.1")
