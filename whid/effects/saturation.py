"""Saturation of the actuator or of the sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.saturation import Saturation as Clip
from whid.diagnostics.rails import Rail, rails
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

FAR = 10.0  # times the range: an end that is none
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
        if self.place == "output":
            yield from self._at_rails(look, sites, bottom - FAR * width, top + FAR * width)
        for share in SHARES:
            low, high = bottom + share * width, top - share * width
            for block, names in (
                (Clip(low=low, high=high, fix=("slope",)), ("low", "high")),
                (Clip(low=bottom - width, high=high, fix=("slope", "low")), ("high",)),
                (Clip(low=low, high=top + width, fix=("slope", "high")), ("low",)),
            ):
                yield sites.inserted(place, block).candidate(*names)

    def _at_rails(self, look: Look, sites: Sites, bottom: float, top: float) -> Iterator[Candidate]:
        """Yield the clip that the raw output shows: a level that it meets again and again, to the last digit."""
        if sites.railed or any(block.kind == self.kind for block in sites.blocks[sites.core[1] :]):
            return
        found = [rails(r.y, r.u, use) for r, use in zip(look.records, look.use, strict=True)]
        low, high = (_same([pair[side] for pair in found]) for side in (0, 1))
        ends = {name: rail for name, rail in (("low", low), ("high", high)) if rail is not None}
        if not ends:
            return
        levels = {"low": bottom, "high": top} | {name: rail.level for name, rail in ends.items()}
        edit = sites.inserted(sites.end, Clip(**levels, fix=True))
        read = tuple((edit.path + name, rail.error) for name, rail in ends.items())
        seen = sum(rail.nats for rail in ends.values())
        yield edit.candidate(*ends)._replace(seen=seen, read=read)


def _same(found: list[Rail | None]) -> Rail | None:
    """Return the rail of all records that have one, None where they do not agree."""
    known = [rail for rail in found if rail is not None]
    return known[0]._replace(nats=sum(r.nats for r in known)) if len({r.level for r in known}) == 1 else None
