"""A staircase of constant levels, up and down."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from annotated_types import Gt

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.experiments.hold import Hold
from whid.signal import Floats

LEVELS = 100_000  # a plan holds one part a level


@dataclass(frozen=True, kw_only=True)
class Staircase(Part):
    """Levels from, from + step, …, to, each held; with `return` the same levels down again.

    u(t) = U_k for (k − 1)·hold_s ≤ t < k·hold_s. An upward staircase alone cannot see memory.
    Source [Brouri2019], eq. (3.12).

    >>> [part.level for part in Staircase(from_=0, to=1, step=0.5, hold_s=10, return_=True).expand(0.1)]
    [0.0, 0.5, 1.0, 0.5, 0.0]
    """

    from_: float
    to: float
    step: Annotated[float, Gt(0)]
    hold_s: Annotated[float, Gt(0)]
    return_: bool = False

    def __post_init__(self) -> None:
        if abs(self.to - self.from_) / self.step > LEVELS:
            raise WhidError("config-value", f"a step of {self.step:g} makes more than {LEVELS} levels", "step")

    def levels(self) -> Floats:
        """Return the levels on the way out."""
        count = int(np.floor(abs(self.to - self.from_) / self.step + 1e-9))
        return np.asarray(self.from_ + np.sign(self.to - self.from_) * self.step * np.arange(count + 1), float)

    def expand(self, dt: float) -> tuple[Part, ...]:
        """Return one hold a level."""
        out = self.levels()
        way = list(out) + (list(out[-2::-1]) if self.return_ else [])
        rises = [way[1] >= way[0] if len(way) > 1 else True] + [b >= a for a, b in pairwise(way)]
        return tuple(
            Hold(level=float(round(u, 12)), hold_s=self.hold_s, direction="up" if up else "down", use=self.use)
            for u, up in zip(way, rises, strict=True)
        )

    def samples(self, dt: float) -> int:
        """Return the samples of all holds."""
        return sum(part.samples(dt) for part in self.expand(dt))

    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return all levels, one after another."""
        return np.concatenate([part.input(dt, rng) for part in self.expand(dt)])
