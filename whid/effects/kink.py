"""A kink of the curve."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.hinge import Hinge
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = tuple(k / 16 for k in range(1, 16))  # of the samples that lie below


@dataclass(frozen=True, kw_only=True)
class Kink(Effect):
    """The curve bends sharply at a level: w = f(v) + slope·max(v − at, 0).

    Its signature lives in amplitude: the residual against v has a corner.
    """

    places: ClassVar[tuple[Place, ...]] = ("nonlinearity",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield kinks at levels over the inner range of v."""
        for place in sites.static:
            low, high = look.span(place)
            for at in look.quantiles(place, SHARES):
                edit = sites.beside(place, Hinge(at=float(at), slope=0.0))
                yield edit.candidate("at", "slope", amplitude=("slope",), rough=(("at", (high - low) / 24),))
