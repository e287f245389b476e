"""What every effect is: edits of the model's tree, with start values; the base screens and scores them all alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from whid.effects._candidate import Candidate
from whid.effects._look import Bools, Look, Noise
from whid.effects._sites import Sites
from whid.kinds import Kind

Place = Literal["input", "front", "back", "nonlinearity", "output", "loop", "parallel", "time", "noise"]
LEAST, MOST = 1 / 3, 3.0  # of a start's change, what screening may scale it by


class Told(NamedTuple):
    """What a description of noise says beside its disturbance: its numbers, the noise it makes, samples to leave the fit."""

    numbers: dict[str, float]
    std: dict[str, float]
    noises: tuple[Noise, ...]
    hidden: tuple[Bools, ...] | None
    penalty: float


class Screened(NamedTuple):
    """A candidate, its numbers moved to where one linear least squares puts them, and what it would explain."""

    effect: Effect
    candidate: Candidate
    gain: float  # log-likelihood, nats, penalties paid
    told: Told | None = None  # of a description of noise


@dataclass(frozen=True, kw_only=True)
class Effect(Kind):
    """A candidate: something that the model lacks, at a place. "Nothing" always competes with it.

    `places` lists where an effect of this kind may sit; `place` is where this one does; `within`: it acts within a sample,
    so that samples alone do not show it. A leaf gives `candidates`: edits of the tree with start values, several for a
    coarse grid of what is not linear. The base does the rest: each candidate is simulated once, what the model's own numbers
    could absorb is projected out, and
    gain = n/2·log(χ²/χ²_left) − k/2·log n − log(values tried).
    """

    family: ClassVar[str] = "whid.effects"
    places: ClassVar[tuple[Place, ...]] = ()
    within: ClassVar[bool] = False
    place: Place

    @property
    def name(self) -> str:
        """Return `kind@place`."""
        return f"{self.kind}@{self.place}"

    @abstractmethod
    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield the edits of the tree that add this effect, none where it has no place."""

    def screen(self, look: Look) -> list[Screened]:
        """Return every candidate by what it would explain, the best first; cheap: one simulation a number, no refit."""
        looped = Sites(look.system, look.core).looped  # a loop costs ten times as much between samples, and a start will do
        near = look if self.within and not looped else look.sampled
        every = list(self.candidates(near, Sites(look.system, look.core)))
        tried = sum(candidate.tried for candidate in every)
        found = [screened for c in every if (screened := _screened(self, c._replace(tried=tried), near)) is not None]
        return sorted(found, key=lambda s: -s.gain)


def gain(look: Look, chi2: float, candidate: Candidate) -> float:
    """Return the log-likelihood that a fall of χ² to `chi2` gains, the effect's numbers and the values tried paid."""
    n = look.samples
    likelihood = n / 2 * np.log(look.chi2 / max(chi2, 1e-300))
    return float(likelihood + candidate.seen + candidate.beyond - candidate.penalty(n))


def _screened(effect: Effect, candidate: Candidate, look: Look) -> Screened | None:
    change = look.along(candidate) if candidate.amplitude else look.change(candidate.system)
    if change is None or not np.any(change):
        return None
    if candidate.amplitude:
        scale = np.linalg.lstsq(change, look.left, rcond=1e-6)[0]
        left = look.left - change @ scale
        candidate = candidate.at(dict(zip(candidate.amplitude, scale.tolist(), strict=True)))
    else:
        size = float(change[:, 0] @ change[:, 0])
        sure = len(candidate.rough) == len(candidate.new) > 0  # no fit will scale what the search finds
        low, high = (1.0, 1.0) if sure else (LEAST, MOST)
        left = look.left - float(np.clip(change[:, 0] @ look.left / size, low, high)) * change[:, 0]
    return Screened(effect, candidate, gain(look, float(left @ left), candidate))
