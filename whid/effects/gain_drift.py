"""A slow drift of the sensor's gain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.gain_drift import GainDrift as Course
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites
from whid.effects.drift import spread

POINTS = (2, 3, 5, 9)


@dataclass(frozen=True, kw_only=True)
class GainDrift(Effect):
    """The output's scale moves: y = x·(1 + s(t)), a straight line or a smooth course through points.

    Its signature lives in time and amplitude: the residual is the output itself, more of it late than early.
    """

    places: ClassVar[tuple[Place, ...]] = ("output",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield a ramp and smooth courses through a few points."""
        start, stop = min(r.t0 for r in look.records), max(float(r.time[-1]) for r in look.records)
        seen = np.sort(np.concatenate([r.time[use] for r, use in zip(look.records, look.use, strict=True)]))
        for points in POINTS:
            names = tuple(f"levels.{k}" for k in range(1, points))
            block = Course(times=spread(seen, points, start, stop), levels=(0.0,) * points, fix=("levels.0",))
            yield sites.inserted(sites.end, block).candidate(*names, amplitude=names)._replace(course=True)
