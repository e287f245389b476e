"""A sensor that hangs now and then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.diagnostics.standing import frozen
from whid.disturbances.dropouts import Dropouts as Hanging
from whid.effects._effect import Place
from whid.effects._look import Bools, Look
from whid.effects._noisy import Fitted, NoiseEffect
from whid.effects._sites import Sites


@dataclass(frozen=True, kw_only=True)
class Dropouts(NoiseEffect):
    """Samples that repeat the one before, a few in a row: y(t_n) = y(t_{n−1}) while the sensor hangs.

    Its signature needs no model: runs of equal values, which noise does not make, away from the rails. Such samples leave
    the fit.
    """

    places: ClassVar[tuple[Place, ...]] = ("output",)

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the frozen samples; each that noise would have moved is a nat or more."""
        if any(noise.kind == "dropouts" for noise in look.system.noise):
            return None
        found = [frozen(r.y, r.u, use) for r, use in zip(look.records, look.use, strict=True)]
        count = sum(int(f.sum()) for f in found)
        if count < 2:
            return None
        rate = count / look.samples
        chance = self._chance(look, found)
        if chance > 0.05:  # a coarse lattice repeats itself without hanging
            return None
        lost = float(np.sqrt(np.mean(np.concatenate([e[f] for e, f in zip(look.errors, found, strict=True)]) ** 2)))
        numbers = {"samples": float(count), "rate": rate}
        nats = -count * np.log(max(chance, 1e-9)) / 2
        std = {"samples": 0.0, "rate": float(np.sqrt(rate / look.samples))}
        return Fitted(Hanging(std=max(lost, 1e-300), rate=rate), float(nats), numbers, std, look.noises, 1, tuple(found))

    def _chance(self, look: Look, found: list[Bools]) -> float:
        """Return how often two samples in a row are equal where nothing hangs."""
        pairs = equal = 0
        for r, use, f in zip(look.records, look.use, found, strict=True):
            free = use[1:] & use[:-1] & ~f[1:] & ~f[:-1] & (r.y[1:] != r.y[use].max()) & (r.y[1:] != r.y[use].min())
            pairs += int(free.sum())
            equal += int((np.diff(r.y) == 0)[free].sum())
        return equal / max(pairs, 1)
