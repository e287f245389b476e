"""A linear path beside the declared one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.linear import Linear
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)


@dataclass(frozen=True, kw_only=True)
class ParallelLinear(Effect):
    """A second path from input to output: y = F(u) + gain/(τs + 1)·u.

    Its signature is linear in the input and knows nothing of the curve.
    """

    places: ClassVar[tuple[Place, ...]] = ("parallel",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield paths of some lags."""
        for samples in SAMPLES:
            branch = Linear(num=(0.0,), den=(samples * look.records[0].dt, 1.0), fix=("den.1",))
            yield sites.along(branch).candidate("num.0", "den.0", amplitude=("num.0",))
