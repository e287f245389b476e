"""Something comes back to the input at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.feedback import Feedback
from whid.blocks.polynomial import Polynomial
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites


def _held(powers: tuple[int, ...]) -> tuple[str, ...]:
    return tuple(f"coefficients.{k}" for k in range(max(powers)) if k not in powers)


@dataclass(frozen=True, kw_only=True)
class FeedbackStatic(Effect):
    """The output acts back on the input: y = F(u − b(y)), b a polynomial.

    Its signature is that of a gain and a bandwidth which move with the level.
    """

    places: ClassVar[tuple[Place, ...]] = ("loop",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield a straight and a bent way back, with an offset."""
        if not sites.moving or sites.looped:
            return
        for powers in ((1,), (0, 1, 2, 3)):
            names = tuple(f"back.coefficients.{k}" for k in powers)
            back = Polynomial(coefficients=(0.0,) * (max(powers) + 1), fix=_held(powers))
            loop = Feedback(forward=sites.declared, back=back, solve="continuous")
            yield sites.around(loop).candidate(*names, amplitude=names)
