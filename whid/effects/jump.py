"""A jump of the curve."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.jump import Jump as Jump_
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = tuple(k / 24 for k in range(1, 24))  # of the samples that lie below


@dataclass(frozen=True, kw_only=True)
class Jump(Effect):
    """The curve jumps at a level: w = f(v) + height for v ≥ at.

    Its signature lives in amplitude: the residual against v steps at one level.
    """

    places: ClassVar[tuple[Place, ...]] = ("nonlinearity",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield jumps at levels over the inner range of v."""
        linear = [k for k, block in enumerate(sites.blocks) if block.kind == "linear"]
        for place in sites.static:
            low, high = look.span(place)
            led = any(k < place for k in linear) and any(k > place for k in linear)  # else it moves no sample
            reach = (high - low) / 24
            for at in look.quantiles(place, SHARES):
                edit = sites.beside(place, Jump_(at=float(at), height=0.0))
                yield edit.candidate("at", "height", amplitude=("height",), rough=() if led else (("at", reach),))
