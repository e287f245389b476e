"""A step of the sensor's gain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.gain_step import GainStep as Step
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites
from whid.effects._switched import switched


@dataclass(frozen=True, kw_only=True)
class GainStep(Effect):
    """The output is scaled from a moment on: y = x·(1 + height) for t ≥ at_s.

    Its signature lives in time and amplitude: from a moment on the residual is the output itself.
    """

    places: ClassVar[tuple[Place, ...]] = ("output",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield the step at the moment that explains most; all moments are tried."""
        at = switched(look, look.signal(sites.end))
        if at is not None:
            edit = sites.inserted(sites.end, Step(at_s=at, height=0.0))
            yield edit.candidate("height", amplitude=("height",), tried=look.samples)
