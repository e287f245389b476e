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
from whid.effects._pulled import pulled
from whid.effects._sites import Sites
from whid.signal import Floats

LEVELS = np.arange(3.0, 1030.0, 0.5)  # in the range; half a level more or less and nothing is explained
COARSE = 40.0  # levels, up to which steps are no small changes: all are simulated
FINER = 24  # of the finer ones that are
BINS = 16  # of the finest step, for the sums over the input's values
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
        """Yield steps of some shares of the range: coarse ones, and of the finer ones those that promise most."""
        low, high = look.span(0)
        promised = _promising(look, high - low)
        for levels in promised:
            step = float((high - low) / levels)
            edit = sites.inserted(0, Steps(step_=step))
            yield edit.candidate("step_", rough=(("step_", step / levels),), tried=len(LEVELS) // len(promised))

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the lattice on which all outputs lie, with log(σ/resolution) nats a sample that it predicts."""
        y = np.concatenate([r.y[use] for r, use in zip(look.records, look.use, strict=True)])
        step = lattice(y)
        spread = float(np.sqrt(look.chi2 / look.samples) * look.noises[0].std) if look.samples else 0.0
        if step is None or step < VISIBLE * spread or any(n.kind == "rounding" for n in look.system.noise):
            return None
        return Fitted(Rounding(std=step / np.sqrt(12)), float(look.samples), {"step": step}, {"step": 0.0}, look.noises)


def _promising(look: Look, width: float) -> Floats:
    """Return the numbers of levels to be simulated, those that promise most of them all where the model tells.

    A fine step changes the input little, and what it explains is ⟨left, change of ŷ⟩ = Σ g(u)·(q(u) − u), for all
    steps by sums over the values that the input takes; against the size of its change, in proportion to the step.
    """
    pull = pulled(look)
    if pull is None or not width > 0:
        return LEVELS
    u, g = np.concatenate([r.u for r in look.records]), np.concatenate(pull)
    values, at = np.unique(np.round(u / width * LEVELS[-1] * BINS), return_inverse=True)
    levels = LEVELS[LEVELS > COARSE]
    share = np.bincount(at, g)
    scaled = values[None] / (LEVELS[-1] * BINS) * levels[:, None]  # u/step
    promise = (np.floor(scaled + 0.5) - scaled) @ share
    best = np.argsort(-promise)[:FINER]
    return np.concatenate([LEVELS[LEVELS <= COARSE], np.sort(levels[best])])
