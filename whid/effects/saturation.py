"""Saturation of the actuator or of the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.saturation import Saturation as Clip
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = (0.01, 0.03, 0.07, 0.12, 0.2, 0.3, 0.4)  # of the range that is cut off at an end


@dataclass(frozen=True, kw_only=True)
class Saturation(Effect):
    """A clip: w = min(max(v, low), high), at one end or at both.

    Its signature is flat: the residual follows the signal beyond a level, and is nothing within.
    """

    places: ClassVar[tuple[Place, ...]] = (
        "input",
        "output",
    )

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield a clip at the top, at the bottom, at both, of some share of the range."""
        place = 0 if self.place == "input" else sites.end
        bottom, top = look.span(place)
        width = top - bottom
        for share in SHARES:
            low, high = bottom + share * width, top - share * width
            for block, names in (
                (Clip(low=low, high=high, fix=("slope",)), ("low", "high")),
                (Clip(low=bottom - width, high=high, fix=("slope", "low")), ("high",)),
                (Clip(low=low, high=top + width, fix=("slope", "high")), ("low",)),
            ):
                yield sites.inserted(place, block).candidate(*names)
