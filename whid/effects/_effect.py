"""What every effect is: edits of the model's tree, with start values; the base screens and scores them all alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from whid.effects._look import Look
from whid.kinds import Kind
from whid.system import System

Place = Literal["input", "front", "back", "nonlinearity", "output", "loop", "parallel", "time", "noise"]
LEAST, MOST = 1 / 3, 3.0  # of a start's change, what screening may scale it by


class Candidate(NamedTuple):
    """An edit of the tree that adds an effect, at start values of its new numbers.

    new        paths in the edited tree of the numbers that the effect brings: reported, and paid for
    amplitude  those of them that scale what it does: at 0 it does nothing. Screening finds them by linear least squares; a
               candidate without any is judged as it stands
    rough      those whose derivative does not lead a fit (a quantiser's step): searched without it
    tried      values of further numbers that were looked at to come to this start
    """

    system: System
    new: tuple[str, ...]
    amplitude: tuple[str, ...] = ()
    rough: tuple[str, ...] = ()
    tried: int = 1

    @property
    def values(self) -> dict[str, float]:
        """Return the new numbers."""
        every = {p.name: p.value for p in self.system.tree.parameters(held=True)}
        return {name: every[name] for name in self.new}

    def at(self, values: dict[str, float]) -> Candidate:
        """Return the candidate at other values of some numbers, kept within their bounds."""
        bounds = {p.name: (p.lower, p.upper) for p in self.system.tree.parameters(held=True)}
        kept = {name: float(np.clip(v, *bounds[name])) for name, v in values.items()}
        tree = self.system.tree.with_parameters(kept)
        return self._replace(system=replace(self.system, chain=tree.chain))


class Screened(NamedTuple):
    """A candidate, its numbers moved to where one linear least squares puts them, and what it would explain."""

    effect: Effect
    candidate: Candidate
    gain: float  # log-likelihood, nats, penalties paid


@dataclass(frozen=True, kw_only=True)
class Effect(Kind):
    """A candidate: something that the model lacks, at a place. "Nothing" always competes with it.

    `places` lists where an effect of this kind may sit; `place` is where this one does. A leaf gives `candidates`: edits of
    the tree with start values, several for a coarse grid of what is not linear. The base does the rest: each candidate is
    simulated once, what the model's own numbers could absorb is projected out, and
    gain = n/2·log(χ²/χ²_left) − k/2·log n − log(values tried).
    """

    family: ClassVar[str] = "whid.effects"
    places: ClassVar[tuple[Place, ...]] = ()
    place: Place

    @property
    def name(self) -> str:
        """Return `kind@place`."""
        return f"{self.kind}@{self.place}"

    @abstractmethod
    def candidates(self, look: Look) -> Iterator[Candidate]:
        """Yield the edits of the tree that add this effect, none where it has no place."""

    def screen(self, look: Look) -> list[Screened]:
        """Return every candidate by what it would explain, the best first; cheap: one simulation a number, no refit."""
        every = list(self.candidates(look))
        tried = sum(candidate.tried for candidate in every)
        found = [screened for c in every if (screened := _screened(self, c._replace(tried=tried), look)) is not None]
        return sorted(found, key=lambda s: -s.gain)


def gain(look: Look, chi2: float, candidate: Candidate) -> float:
    """Return the log-likelihood that a fall of χ² to `chi2` gains, the effect's numbers and the values tried paid."""
    n = look.samples
    likelihood = n / 2 * np.log(look.chi2 / max(chi2, 1e-300))
    return float(likelihood - len(candidate.new) / 2 * np.log(n) - np.log(candidate.tried))


def _screened(effect: Effect, candidate: Candidate, look: Look) -> Screened | None:
    if candidate.amplitude:
        values = candidate.values
        zero = dict.fromkeys(candidate.amplitude, 0.0)
        systems = [candidate.at(zero | {name: values[name]}).system for name in candidate.amplitude]
        change = look.change(systems)
        if change is None:
            return None
        scale = np.linalg.lstsq(change, look.left, rcond=1e-6)[0]
        left = look.left - change @ scale
        candidate = candidate.at({name: values[name] * s for name, s in zip(candidate.amplitude, scale, strict=True)})
    else:
        change = look.change([candidate.system])
        if change is None or not (size := float(change[:, 0] @ change[:, 0])) > 0:
            return None
        left = look.left - float(np.clip(change[:, 0] @ look.left / size, LEAST, MOST)) * change[:, 0]
    return Screened(effect, candidate, gain(look, float(left @ left), candidate))


def best(found: Sequence[Screened]) -> Screened | None:
    """Return the candidate that explains most."""
    return max(found, key=lambda s: s.gain, default=None)
