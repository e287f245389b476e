"""Single wild samples of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.disturbances.outliers import Outliers as Wild
from whid.effects._effect import Place
from whid.effects._look import Bools, Look
from whid.effects._noisy import Fitted, NoiseEffect
from whid.effects._sites import Sites
from whid.signal import Floats

REACH = 3  # neighbours on either side that an outlier stands out of
FAR = 4.5  # of σ: what stands out further is wild


@dataclass(frozen=True, kw_only=True)
class Outliers(NoiseEffect):
    """Few samples that are wrong by many σ: e ~ (1 − rate)·N(0, σ²) + rate·N(0, large²).

    Its signature is isolated: one sample stands out of its neighbours, before and after it nothing is wrong. Such samples
    leave the fit.
    """

    places: ClassVar[tuple[Place, ...]] = ("output",)

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the samples that stand out, and how much likelier two variances make the residual than one."""
        if any(noise.kind == "outliers" for noise in look.system.noise):
            return None
        shapes = [np.ones(1) if noise.shape is None else noise.shape for noise in look.noises]
        errors = [e / shape for e, shape in zip(look.errors, shapes, strict=True)]
        wild = [_standing_out(e, use) for e, use in zip(errors, look.use, strict=True)]
        e = np.concatenate([x[use] for x, use in zip(errors, look.use, strict=True)])
        hit = np.concatenate([w[use] for w, use in zip(wild, look.use, strict=True)])
        if hit.sum() < 2 or hit.mean() > 0.1:
            return None
        rate, large, small = float(hit.mean()), float(np.mean(e[hit] ** 2)), float(np.var(e[~hit]))
        one = -0.5 * np.log(np.var(e)) - e**2 / (2 * np.var(e))
        two = np.logaddexp(
            np.log1p(-rate) - 0.5 * np.log(small) - e**2 / (2 * small),
            np.log(rate) - 0.5 * np.log(large) - e**2 / (2 * large),
        )
        raw = np.concatenate([x[use] for x, use in zip(look.errors, look.use, strict=True)])
        block = Wild(std=float(np.sqrt(rate * np.mean(raw[hit] ** 2))), rate=rate)
        std = {"rate": float(np.sqrt(rate / len(e))), "std": block.std / np.sqrt(2 * hit.sum())}
        numbers = {"rate": rate, "std": float(block.std or 0.0)}
        return Fitted(block, float(np.sum(two - one)), numbers, std, look.noises, 1, tuple(wild))


def _standing_out(error: Floats, use: Bools) -> Bools:
    """Return where a sample stands out of its neighbours by more than noise does."""
    e = np.where(use, error, 0.0)
    padded = np.pad(e, REACH, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH + 1)
    near = np.delete(around, REACH, axis=1)
    left = e - np.median(near, axis=1)
    size = float(np.median(np.abs(left[use])) / 0.6745) if use.any() else 1.0
    return np.asarray((np.abs(left) > FAR * size) & use)
