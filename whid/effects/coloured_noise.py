"""Noise with a memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.disturbances.ar import Ar
from whid.effects._effect import Place
from whid.effects._look import Look, Noise
from whid.effects._noisy import Fitted, NoiseEffect
from whid.effects._sites import Sites
from whid.signal import rms
from whid.stages._whiten import autoregression, whitened


@dataclass(frozen=True, kw_only=True)
class ColouredNoise(NoiseEffect):
    """Noise that was declared white and is not: e(t) = Σ_k a_k·e(t − k) + white.

    Its signature is a residual that can be told from its own past, and not from the input.
    """

    places: ClassVar[tuple[Place, ...]] = ("noise",)

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the autoregression, its order by BIC, and how much likelier the innovations are."""
        if any(len(noise.ar) or noise.shape is not None for noise in look.noises) or any(
            noise.kind == "process" for noise in look.system.noise
        ):
            return None  # the colour is known, or that of the blocks behind the curve, or the size varies
        nats, noises, longest = 0.0, [], np.empty(0)
        for error, use in zip(look.errors, look.use, strict=True):
            ar = autoregression(error, use)
            before = np.where(use, error, 0.0)
            after = whitened(before[:, None], use, ar)[use, 0]
            nats += int(use.sum()) * float(np.log(rms(before[use]) / max(rms(after), 1e-300)))
            noises.append(Noise(max(rms(after), 1e-300), tuple(ar.tolist())))
            longest = ar if len(ar) > len(longest) else longest
        if not len(longest):
            return None
        size = float(np.concatenate([e[u] for e, u in zip(look.errors, look.use, strict=True)]).std())
        numbers = {f"coefficients.{k}": float(a) for k, a in enumerate(longest)}
        error_ = 1 / np.sqrt(look.samples)
        std = {name: float(error_) for name in numbers}
        return Fitted(Ar(coefficients=tuple(longest.tolist()), std=size), nats, numbers, std, tuple(noises))
