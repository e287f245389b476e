"""Something comes back to the input, later."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.feedback import Feedback
from whid.blocks.linear import Linear
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (5.0, 30.0)


@dataclass(frozen=True, kw_only=True)
class FeedbackDynamic(Effect):
    """The output acts back on the input through a lag: y = F(u − gain/(τs + 1)·y).

    Its signature is that of a plant whose gain at low frequency differs from that at high frequency.
    """

    places: ClassVar[tuple[Place, ...]] = ("loop",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield lags of some samples and of many."""
        if not sites.moving or sites.looped:
            return
        for samples in SAMPLES:
            back = Linear(num=(0.0,), den=(samples * look.records[0].dt, 1.0), fix=("den.1",))
            loop = Feedback(forward=sites.declared, back=back, solve="continuous")
            yield sites.around(loop).candidate("back.num.0", "back.den.0", amplitude=("back.num.0",))
