"""Play in the actuator or in the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.backlash import Backlash as Play
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = (0.002, 0.006, 0.015, 0.04, 0.08, 0.15, 0.3)  # of the range


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """A gap: w rests until v has crossed it, then follows: w = v − gap/2 while v rises, w = v + gap/2 while it falls.

    Its signature is a difference between up and down branches, and a phase that does not go to 0 with frequency.
    """

    places: ClassVar[tuple[Place, ...]] = (
        "input",
        "output",
    )

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield gaps of some shares of the range."""
        place = 0 if self.place == "input" else sites.end
        low, high = look.span(place)
        for share in SHARES:
            gap = share * (high - low)
            yield sites.inserted(place, Play(gap=gap)).candidate("gap")
