"""A clock that trembles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.disturbances.jitter import Jitter as Trembling
from whid.effects._effect import Place
from whid.effects._look import Look
from whid.effects._noisy import Fitted, NoiseEffect, shaped, stacked, stacked_errors, variances
from whid.effects._sites import Sites


@dataclass(frozen=True, kw_only=True)
class Jitter(NoiseEffect):
    """Samples taken a little early or late: e ~ N(0, σ₀² + (std·dx/dt)²).

    Its signature is a scatter that is large where the output moves fast, and nothing where it rests.
    """

    places: ClassVar[tuple[Place, ...]] = ("time",)

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the tremble that makes the residual likeliest."""
        if any(noise.kind == "jitter" for noise in look.system.noise):
            return None
        f = tuple(np.gradient(p, r.dt) ** 2 for p, r in zip(look.predicted, look.records, strict=True))
        every = stacked(look, f, 2)
        if not every.any():
            return None
        found = variances(stacked_errors(look), every)
        std = float(np.sqrt(found.share))
        noises = shaped(look, found.base, found.share, f)
        return Fitted(Trembling(std=std), found.nats, {"std": std}, {"std": found.share_std / (2 * std)}, noises)
