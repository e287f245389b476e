"""A smooth curve where a straight line was declared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.bend import Bend
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

POWERS = ((1,), (2,), (1, 2), (1, 2, 3, 4), (1, 2, 3, 4, 5, 6))  # beyond the first


def _held(powers: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(f"coefficients.{k - 1}" for k in range(1, max(powers)) if k not in powers)


@dataclass(frozen=True, kw_only=True)
class Curve(Effect):
    """The actuator or the sensor is slightly bent: w = v + offset + Σ_k c_k·((v − centre)/scale)^(k+2).

    Its signature lives in amplitude: the residual against the signal is a smooth curve, the same up and down. A curve bent
    about its middle is off at 0 as well: a plant without an offset of its own cannot absorb that.
    """

    places: ClassVar[tuple[Place, ...]] = (
        "input",
        "output",
    )

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield bends by the square, by the cube, by both, and by more powers, each without and with an offset."""
        place = 0 if self.place == "input" else sites.end
        low, high = look.span(place)
        centre, scale = (low + high) / 2, (high - low) / 2
        if not scale > 0:
            return
        for powers in POWERS:
            names = tuple(f"coefficients.{k - 1}" for k in powers)
            for more in ((), ("offset",)):
                fixed = (*_held(powers), *(() if more else ("offset",)))
                block = Bend(coefficients=(0.0,) * max(powers), centre=centre, scale=scale, fix=fixed)
                yield sites.inserted(place, block).candidate(*names, *more, amplitude=(*names, *more))
