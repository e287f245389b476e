"""Input and output are on different clocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.clock_skew import ClockSkew as ClockSkew_
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (0.1, 0.5, 1.5, 4.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class ClockSkew(Effect):
    """The output's clock runs fast or slow: y(t) = x(t + skew·t).

    Its signature is a delay that grows with time: late repeats lag early ones.
    """

    places: ClassVar[tuple[Place, ...]] = ("time",)
    within: ClassVar[bool] = True

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield skews that make some samples by the end."""
        length = max(len(r) for r in look.records)
        for samples in SAMPLES:
            for sign in (1, -1):
                block = ClockSkew_(skew=sign * samples / length)
                yield sites.inserted(sites.end, block).candidate("skew")
