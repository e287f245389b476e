"""Corners that are rounded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from whid.blocks._block import Block
from whid.blocks.spline import Spline
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SHARES = (0.01, 0.03, 0.08, 0.2, 0.5)  # of the range of v
# of a free shape: its reach on either side of a corner, of the range of v, and its points, the ends on the declared curve; a
# wide one with many points could not be told from the corner's own place and slopes
SHAPES = ((0.05, 9), (0.12, 9), (0.12, 13), (0.3, 9))


@dataclass(frozen=True, kw_only=True)
class SoftKnee(Effect):
    """The declared curve's corners are soft: a parabola over a width, as the block's `knee`; or a shape of their own,
    f(v) + s(v), s a spline about the corner that is 0 at the ends of its reach.

    Its signature lives in amplitude, at the corners, on their inner side.
    """

    places: ClassVar[tuple[Place, ...]] = ("nonlinearity",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield widths for every declared curve that has corners, then shapes of every corner."""
        for place in sites.static:
            block = sites.blocks[place]
            if not hasattr(block, "knee") or block.knee or not len(block.breakpoints()):  # type: ignore[attr-defined]
                continue
            low, high = look.span(place)
            for share in SHARES:
                soft = replace(block, knee=share * (high - low))  # type: ignore[call-arg]
                yield sites.replaced(place, soft).candidate("knee")
            yield from _shapes(block, sites, place, low, high)


def _shapes(block: Block, sites: Sites, place: int, low: float, high: float) -> Iterator[Candidate]:
    """Yield a spline beside the curve about every corner that the signal meets."""
    for corner in (b for b in block.breakpoints() if low < b < high):  # type: ignore[attr-defined]
        for reach, points in SHAPES:
            ends, names = ("outputs.0", f"outputs.{points - 1}"), tuple(f"outputs.{k}" for k in range(1, points - 1))
            inputs = corner + reach * (high - low) * np.linspace(-1, 1, points)
            shape = Spline(inputs=tuple(inputs.tolist()), outputs=(0.0,) * points, fix=ends)
            yield sites.beside(place, shape).candidate(*names, amplitude=names)
