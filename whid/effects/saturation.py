"""Saturation of the actuator or of the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.saturation import Saturation as Clip
from whid.effects._effect import Candidate, Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = (0.002, 0.01, 0.03, 0.08, 0.15, 0.25)  # of the samples that are cut off


@dataclass(frozen=True, kw_only=True)
class Saturation(Effect):
    """A clip: w = min(max(v, low), high), at one end or at both.

    Its signature is flat: the residual follows the signal beyond a level, and is nothing within.
    """

    places: ClassVar[tuple[Place, ...]] = ("input", "output")

    def candidates(self, look: Look) -> Iterator[Candidate]:
        """Yield a clip at the top, at the bottom, at both, of some share of the samples."""
        sites = Sites(look.system)
        place = 0 if self.place == "input" else sites.end
        for share in SHARES:
            low, high = map(float, look.quantiles(place, (share, 1 - share)))
            bottom, top = map(float, look.quantiles(place, (0.0, 1.0)))
            if not bottom < low < high < top:
                continue
            beyond = top - bottom
            for block, names in (
                (Clip(low=low, high=high, fix=("slope",)), ("low", "high")),
                (Clip(low=bottom - beyond, high=high, fix=("slope", "low")), ("high",)),
                (Clip(low=low, high=top + beyond, fix=("slope", "high")), ("low",)),
            ):
                edit = sites.inserted(place, block)
                yield Candidate(edit.system, tuple(edit.path + name for name in names))
