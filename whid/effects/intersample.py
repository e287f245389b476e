"""The input does something else between samples than declared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.intersample import Intersample as Course
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites


@dataclass(frozen=True, kw_only=True)
class Intersample(Effect):
    """The input runs straight between its samples where it was declared held, or the other way round.

    Its signature is that of half a sample's delay; it is looked for before everything else.
    """

    places: ClassVar[tuple[Place, ...]] = ("time",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield the courses that were not declared."""
        declared = look.records[0].intersample
        if declared == "discrete" or sites.blocks[0].kind == "intersample":
            return
        for between in ("zoh", "foh", "bandlimited"):
            if between != declared:
                yield sites.inserted(0, Course(between=between)).candidate()
