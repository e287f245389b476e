"""A dead zone in the actuator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.dead_zone import DeadZone as Gap
from whid.effects._effect import Candidate, Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = (0.01, 0.03, 0.08, 0.15, 0.3)  # of the range, either side of 0


@dataclass(frozen=True, kw_only=True)
class DeadZone(Effect):
    """Small inputs are not passed on: w = v − low below low, 0 between, v − high above high.

    Its signature is odd and has no memory: up and down branches agree, where those of a backlash part.
    """

    places: ClassVar[tuple[Place, ...]] = ("input",)

    def candidates(self, look: Look) -> Iterator[Candidate]:
        """Yield dead zones around 0, symmetric and one-sided."""
        sites = Sites(look.system)
        bottom, top = look.quantiles(0, (0.0, 1.0))
        for share in SHARES:
            half = float(share * max(abs(bottom), abs(top)))
            for low, high in ((-half, half), (-half, 0.1 * half), (-0.1 * half, half)):
                edit = sites.inserted(0, Gap(low=low, high=high, fix=("slope",)))
                yield Candidate(edit.system, (edit.path + "low", edit.path + "high"))
