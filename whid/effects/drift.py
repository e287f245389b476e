"""A slow drift of the sensor's zero."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.drift import Drift as Course
from whid.blocks.tone import Tone
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

POINTS = (2, 4, 8, 16, 32, 64)
CYCLES = np.arange(1.5, 10.25, 0.5)  # a record


@dataclass(frozen=True, kw_only=True)
class Drift(Effect):
    """The output's zero moves: y = x + s(t), a straight line, a smooth course through points, or a slow sine.

    Its signature lives in time: the residual's mean over stretches moves, early differs from late.
    """

    places: ClassVar[tuple[Place, ...]] = ("output",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield a ramp, smooth courses through more and more points, and the slow sine that fits best."""
        start, stop = min(r.t0 for r in look.records), max(float(r.time[-1]) for r in look.records)
        for points in POINTS:
            names = tuple(f"levels.{k}" for k in range(points))
            block = Course(times=tuple(np.linspace(start, stop, points).tolist()), levels=(0.0,) * points)
            yield sites.inserted(sites.end, block).candidate(*names, amplitude=names)._replace(course=True)
        if len(look.records) == 1:
            for cycles in CYCLES:
                block_ = Tone(omega=2 * np.pi * cycles / (stop - start), cos=(0.0,), sin=(0.0,))
                yield sites.added(block_).candidate("omega", "cos.0", "sin.0", amplitude=("cos.0", "sin.0"))
