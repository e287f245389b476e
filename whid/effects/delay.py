"""Something arrives later than declared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.delay import Delay as Delay_
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (0.05, 0.15, 0.35, 0.7, 1.2, 2.0, 3.0, 4.5, 7.0, 12.0)


@dataclass(frozen=True, kw_only=True)
class Delay(Effect):
    """A delay: y(t) = x(t − seconds), whole samples or a part of one; in front and behind it is the same.

    Its signature is a phase that grows in proportion to frequency.
    """

    places: ClassVar[tuple[Place, ...]] = ("time",)
    within: ClassVar[bool] = True

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield parts of a sample and some samples."""
        for samples in SAMPLES:
            block = Delay_(seconds=samples * look.records[0].dt)
            yield sites.inserted(sites.end, block).candidate("seconds")
