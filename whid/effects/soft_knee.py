"""Corners that are rounded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = (0.01, 0.03, 0.08, 0.2, 0.5)  # of the range of v


@dataclass(frozen=True, kw_only=True)
class SoftKnee(Effect):
    """The declared curve's corners are soft: a parabola over a width, as the block's `knee`.

    Its signature lives in amplitude, at the corners, on their inner side.
    """

    places: ClassVar[tuple[Place, ...]] = ("nonlinearity",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield widths for every declared curve that has corners."""
        for place in sites.static:
            block = sites.blocks[place]
            if not hasattr(block, "knee") or block.knee or not len(block.breakpoints()):  # type: ignore[attr-defined]
                continue
            low, high = look.span(place)
            for share in SHARES:
                soft = replace(block, knee=share * (high - low))  # type: ignore[call-arg]
                yield sites.replaced(place, soft).candidate("knee")
