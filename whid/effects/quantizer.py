"""A converter of too few bits, at the input or at the output."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.quantizer import Quantizer as Steps
from whid.diagnostics.lattice import lattice
from whid.disturbances.rounding import Rounding
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place, Screened
from whid.effects._look import Look
from whid.effects._noisy import Fitted, NoiseEffect
from whid.effects._sites import Sites

LEVELS = np.arange(3.0, 260.0, 0.5)  # in the range; half a level more or less and nothing is explained
VISIBLE = 0.2  # of σ: a finer step is how the file was written, not what the converter does


@dataclass(frozen=True, kw_only=True)
class Quantizer(NoiseEffect):
    """Values that come in steps: w = step·round(v/step).

    At the input its signature is a residual that looks random but repeats with the input; at the output every value lies on
    a lattice, which needs no model to be seen.
    """

    places: ClassVar[tuple[Place, ...]] = ("input", "output")

    def screen(self, look: Look) -> list[Screened]:
        """Return steps of the input, or the lattice of the output."""
        return Effect.screen(self, look) if self.place == "input" else NoiseEffect.screen(self, look)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield steps of some shares of the range."""
        low, high = look.span(0)
        for levels in LEVELS:
            step = float((high - low) / levels)
            edit = sites.inserted(0, Steps(step_=step))
            yield edit.candidate("step_", rough=(("step_", step / levels),))

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the lattice on which all outputs lie, with log(σ/resolution) nats a sample that it predicts."""
        y = np.concatenate([r.y[use] for r, use in zip(look.records, look.use, strict=True)])
        step = lattice(y)
        spread = float(np.sqrt(look.chi2 / look.samples) * look.noises[0].std) if look.samples else 0.0
        if step is None or step < VISIBLE * spread or any(n.kind == "rounding" for n in look.system.noise):
            return None
        return Fitted(Rounding(std=step / np.sqrt(12)), float(look.samples), {"step": step}, {"step": 0.0}, look.noises)
