"""A dead zone in the actuator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.dead_zone import DeadZone as Gap
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = (0.005, 0.015, 0.04, 0.08, 0.15, 0.25, 0.4)  # of the reach, either side of 0


@dataclass(frozen=True, kw_only=True)
class DeadZone(Effect):
    """Small inputs are not passed on: w = v − low below low, 0 between, v − high above high.

    Its signature is odd and has no memory: up and down branches agree, where those of a backlash part.
    """

    places: ClassVar[tuple[Place, ...]] = ("input",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield dead zones around 0, symmetric and one-sided."""
        reach = max(map(abs, look.span(0)))
        for share in SHARES:
            half = share * reach
            for low, high in ((-half, half), (-half, 0.1 * half), (-0.1 * half, half)):
                yield sites.inserted(0, Gap(low=low, high=high, fix=("slope",))).candidate("low", "high")
