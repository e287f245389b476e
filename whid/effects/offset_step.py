"""A step of the sensor's zero."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.offset_step import OffsetStep as Step
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites
from whid.effects._switched import switched


@dataclass(frozen=True, kw_only=True)
class OffsetStep(Effect):
    """The output is shifted from a moment on: y = x + height for t ≥ at_s.

    Its signature lives in time: the residual's mean steps once.
    """

    places: ClassVar[tuple[Place, ...]] = ("output",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield the step at the moment that explains most; all moments are tried."""
        at = switched(look, [np.ones(len(r)) for r in look.records])
        if at is not None:
            edit = sites.inserted(sites.end, Step(at_s=at, height=0.0))
            yield edit.candidate("height", amplitude=("height",), tried=look.samples)
