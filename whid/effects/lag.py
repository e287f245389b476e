"""An extra pole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.linear import Linear
from whid.effects._effect import Candidate, Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites

SAMPLES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)


@dataclass(frozen=True, kw_only=True)
class Lag(Effect):
    """An extra pole in front of the nonlinearity or behind it: G = 1/(τs + 1).

    Its signature is a phase that grows with frequency, ahead of the curve or behind it; a short one looks like a delay.
    """

    places: ClassVar[tuple[Place, ...]] = ("front", "back")

    def candidates(self, look: Look) -> Iterator[Candidate]:
        """Yield a lag of some samples, and of many."""
        sites = Sites(look.system)
        if self.place == "front" and sites.front is None:
            return  # in a linear chain it is the same as behind
        place = sites.end if self.place == "back" else int(sites.front or 0)
        dt = look.records[0].dt
        for tau in np.array(SAMPLES) * dt:
            edit = sites.inserted(place, Linear(num=(1.0,), den=(float(tau), 1.0), fix=("num", "den.1")))
            yield Candidate(edit.system, (edit.path + "den.0",))
