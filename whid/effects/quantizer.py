"""An input that comes in steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.quantizer import Quantizer as Steps
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites


SHARES = np.geomspace(2e-3, 0.3, 60)  # of the range; a step that is off by a tenth explains nothing


@dataclass(frozen=True, kw_only=True)
class Quantizer(Effect):
    """A converter of too few bits: w = step·round(v/step).

    Its signature is a residual that looks random but repeats with the input.
    """

    places: ClassVar[tuple[Place, ...]] = ("input",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield steps of some shares of the range."""
        low, high = look.span(0)
        for share in SHARES:
            edit = sites.inserted(0, Steps(step_=float(share * (high - low))))
            yield edit.candidate("step_", rough=("step_",))
