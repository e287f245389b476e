"""Noise that grows with the output."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.disturbances.level import Level
from whid.effects._effect import Place
from whid.effects._look import Look
from whid.effects._noisy import Fitted, NoiseEffect, shaped, stacked, stacked_errors, variances
from whid.effects._sites import Sites


@dataclass(frozen=True, kw_only=True)
class LevelNoise(NoiseEffect):
    """Noise whose size follows the output: e ~ N(0, σ₀² + (std·x)²).

    Its signature lives in amplitude: the residual's scatter, not its mean, grows with |ŷ|.
    """

    places: ClassVar[tuple[Place, ...]] = ("noise",)

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the share of the output that makes the residual likeliest."""
        if any(noise.kind == "level" for noise in look.system.noise):
            return None
        f = tuple(p**2 for p in look.predicted)
        found = variances(stacked_errors(look), stacked(look, f, 2))
        std = float(np.sqrt(found.share))
        noises = shaped(look, found.base, found.share, f)
        numbers = {"std": std}
        return Fitted(Level(std=std), found.nats, numbers, {"std": found.share_std / (2 * std)}, noises)
