"""A slow drift of the sensor's zero."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.drift import Drift as Course
from whid.blocks.tone import Tone
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place, Screened
from whid.effects._filtered import walking
from whid.effects._look import Look
from whid.effects._sites import Sites
from whid.signal import Floats

LIKELY = 15.0  # nats of the finest course, below which no walk is looked for
POINTS = (2, 3, 4, 6, 8, 16, 32, 64)
ABSORBED = 0.03  # of a constant: what the model's own numbers leave of it where they hold an offset
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
        seen = np.sort(np.concatenate([r.time[use] for r, use in zip(look.records, look.use, strict=True)]))
        held = 1 if _free_offset(look) else 0
        for points in POINTS:
            names = tuple(f"levels.{k}" for k in range(held, points))
            fixed = tuple(f"levels.{k}" for k in range(held))
            block = Course(times=spread(seen, points, start, stop), levels=(0.0,) * points, fix=fixed)
            yield sites.inserted(sites.end, block).candidate(*names, amplitude=names)._replace(course=True)
        if len(look.records) == 1:
            for cycles in CYCLES:
                block_ = Tone(omega=2 * np.pi * cycles / (stop - start), cos=(0.0,), sin=(0.0,))
                yield sites.added(block_).candidate("omega", "cos.0", "sin.0", amplitude=("cos.0", "sin.0"))

    def screen(self, look: Look) -> list[Screened]:
        """Return the courses as every effect does; the finest one, where it is a random walk, by the walk's likelihood.

        The walk has one number, the size of its steps: that is paid, and what the course fits of noise beyond the walk. What
        the walk explains between the points of the course is `beyond`.
        """
        found = super().screen(look)
        finest = next((s for s in found if len(s.candidate.new) >= POINTS[-1] - 1), None)
        if finest is None or len(look.records) != 1:
            return found
        nats = finest.gain + finest.candidate.penalty(look.samples)
        if nats < LIKELY:
            return found
        every = np.zeros(len(look.records[0]))
        every[look.use[0]] = look.left
        steps = 6 * np.expm1(2 * nats / look.samples) / len(every)  # of a walk that scatters so much about its mean
        walk = walking(every, look.use[0], float(steps))
        number = np.log(look.samples) / 2
        worth = walk.nats - number
        if worth > finest.gain:
            walked = finest.candidate._replace(
                paid=float(number + max(nats - walk.nats, 0.0)), beyond=float(max(walk.nats - nats, 0.0))
            )
            found = [finest._replace(candidate=walked, gain=float(worth)), *(s for s in found if s is not finest)]
        return sorted(found, key=lambda s: -s.gain)


def _free_offset(look: Look) -> bool:
    """Tell whether the model has an offset of its own: a course's level and that would only undo each other."""
    one = look.rows([np.ones((len(r), 1)) for r in look.records])
    return bool(np.linalg.norm(look.rest(one)) < ABSORBED * np.linalg.norm(one))


def spread(seen: Floats, points: int, start: float, stop: float) -> tuple[float, ...]:
    """Return the points of a course: as many samples that count between any two, the ends those of the record.

    >>> spread(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 3, 0.0, 9.0)
    (0.0, 2.0, 9.0)
    """
    inner = np.quantile(seen, np.linspace(0, 1, points)[1:-1]).tolist()
    return (start, *inner, stop)
