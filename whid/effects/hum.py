"""A steady tone on the output."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.tone import Tone
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._line import strongest
from whid.effects._look import Look
from whid.effects._sites import Sites

HARMONICS = ((1,), (1, 2), (1, 3), (1, 3, 5), (1, 2, 3))


@dataclass(frozen=True, kw_only=True)
class Hum(Effect):
    """A tone and its harmonics: y = x + Σ_h a_h·cos(hωt) + b_h·sin(hωt), ω unknown.

    Its signature is a line in frequency, between the excitation's lines, with one phase over the whole record.
    """

    places: ClassVar[tuple[Place, ...]] = ("output",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield the strongest line of the residual, alone and with harmonics."""
        omega, lines = strongest(look)
        if omega is None:
            return
        for harmonics in HARMONICS:
            if max(harmonics) * omega * look.records[0].dt >= np.pi:
                continue
            count = len(harmonics)
            block = Tone(omega=omega, cos=(0.0,) * count, sin=(0.0,) * count, harmonics=harmonics)
            names = tuple(f"{wave}.{k}" for wave in ("cos", "sin") for k in range(count))
            yield sites.added(block).candidate("omega", *names, amplitude=names, tried=lines)
