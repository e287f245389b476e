"""Effects that are noise: they change nothing of ŷ, only how likely the residual is; the same currency, nats."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from whid.disturbances._disturbance import Disturbance
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Screened, Told
from whid.effects._look import Bools, Look, Noise
from whid.effects._sites import Sites
from whid.signal import Floats

RATIOS = np.geomspace(1e-3, 1e4, 71)  # of the two variances


class Fitted(NamedTuple):
    """What a noise effect says: its disturbance, the nats it gains before penalties, its numbers, the noise it makes."""

    disturbance: Disturbance
    nats: float
    numbers: dict[str, float]
    std: dict[str, float]
    noises: tuple[Noise, ...]
    tried: int = 1
    hidden: tuple[Bools, ...] | None = None  # masks of samples that are to leave the fit


@dataclass(frozen=True, kw_only=True)
class NoiseEffect(Effect):
    """A leaf says how much likelier the residual becomes; the base pays the penalties and adds the disturbance."""

    @abstractmethod
    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the disturbance that makes the residual likeliest, None where there is nothing to say."""

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield nothing: no edit of the tree makes noise."""
        return iter(())

    def screen(self, look: Look) -> list[Screened]:
        """Return the one description, by how much likelier it makes the residual."""
        found = self.explain(look, Sites(look.system, look.core))
        if found is None or not np.isfinite(found.nats):
            return []
        system = look.system.disturbed(found.disturbance)
        penalty = len(found.numbers) / 2 * np.log(look.samples) + np.log(found.tried)
        told = Told(found.numbers, found.std, found.noises, found.hidden, float(penalty))
        return [Screened(self, Candidate(system, look.core, ()), float(found.nats - penalty), told)]


class Variances(NamedTuple):
    """σ₀² + σ₁²·f: what makes a residual likeliest."""

    base: float
    share: float  # σ₁²
    share_std: float
    nats: float  # over one variance for all


def variances(e: Floats, f: Floats) -> Variances:
    """Return the two variances of e ~ N(0, σ₀² + σ₁²·f) by maximum likelihood; f (n,) ≥ 0.

    For a ratio ρ = σ₁²/σ₀² the best σ₀² is the mean of e²/(1 + ρf); the ratio by a grid and a parabola through its top.
    """
    n, scale = len(e), max(float(np.mean(f)), 1e-300)
    g = f / scale

    def nats(rho: float) -> float:
        w = 1 + rho * g
        return float(-n / 2 * np.log(np.mean(e**2 / w)) - np.log(w).sum() / 2)

    none = nats(0.0)
    every = np.array([nats(r) for r in RATIOS])
    k = int(np.clip(np.argmax(every), 1, len(RATIOS) - 2))
    step = np.log(RATIOS[1] / RATIOS[0])
    low, here, high = every[k - 1 : k + 2]
    bend = low - 2 * here + high
    move = float(np.clip((low - high) / (2 * bend), -1, 1)) if bend < 0 else 0.0
    rho = float(RATIOS[k] * np.exp(step * move))
    std = step / np.sqrt(-bend) if bend < 0 else np.inf  # of log ρ
    base = float(np.mean(e**2 / (1 + rho * g)))
    return Variances(base, rho * base / scale, rho * base / scale * float(std), max(nats(rho), float(here)) - none)


def stacked_errors(look: Look) -> Floats:
    """Return the residual at the samples that count, record after record, over the shape that its noise is known to have."""
    return stacked(look, look.errors, 1)


def stacked(look: Look, each: tuple[Floats, ...], power: int) -> Floats:
    """Return courses at the samples that count, one after another, over a power of the noise's known shape."""
    shapes = (np.ones(len(u)) if n.shape is None else n.shape for n, u in zip(look.noises, look.use, strict=True))
    return np.concatenate([x[u] / s[u] ** power for x, u, s in zip(each, look.use, shapes, strict=True)])


def shaped(look: Look, base: float, share: float, f: tuple[Floats, ...]) -> tuple[Noise, ...]:
    """Return the noises whose σ varies: √(σ₀²·shape² + σ₁²·f), shape what was known of it before."""
    return tuple(
        replace(
            noise, std=1.0, shape=np.sqrt(base * (1.0 if noise.shape is None else noise.shape**2) + share * np.asarray(each))
        )
        for noise, each in zip(look.noises, f, strict=True)
    )
