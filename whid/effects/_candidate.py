"""An edit of the tree that adds an effect, at start values of its new numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from whid.system import System

CHANCE = 1e-3  # of naming an effect where nothing is missing, all of them together


class Candidate(NamedTuple):
    """An edit of the tree that adds an effect, at start values of its new numbers.

    core       where in the edited series the declared blocks are
    new        paths in the edited tree of the numbers that the effect brings: reported, and paid for
    amplitude  those of them that scale what it does: at 0 it does nothing. Screening finds them by linear least squares; a
               candidate without any is judged as it stands
    rough      those whose derivative does not lead a fit (a quantiser's step), with the reach of a search without it
    tried      values of further numbers that were looked at to come to this start
    seen       nats by which the raw record speaks for it, without any model
    terms      parts of the effect that can do without each other: the name of each and its numbers
    course     the numbers are a course in time, each one seen by its own stretch of the record only
    paid       nats that the numbers cost where a likelihood of their own says so (levels that are a random walk)
    beyond     nats by which that likelihood exceeds what the numbers carry (the walk between two points of a course)
    read       numbers that were read off the record and are held, with their standard error
    """

    system: System
    core: tuple[int, int]
    new: tuple[str, ...]
    amplitude: tuple[str, ...] = ()
    rough: tuple[tuple[str, float], ...] = ()
    tried: int = 1
    seen: float = 0.0
    read: tuple[tuple[str, float], ...] = ()
    terms: tuple[tuple[str, tuple[str, ...]], ...] = ()
    course: bool = False
    paid: float | None = None
    beyond: float = 0.0

    def penalty(self, samples: int) -> float:
        """Return the nats that its numbers and the values tried cost: ½·log of the samples that see a number, each."""
        if self.paid is not None:
            return self.paid
        count = len(self.new)
        each = samples / max(count, 1) if self.course else samples
        return float(count / 2 * np.log(each) + np.log(self.tried))

    def chance(self, samples: int, of: int) -> float:
        """Return the nats, penalty paid, that chance alone gains once in a thousand records, `of` so many effects tried.

        Where nothing is missing twice the likelihood's gain is χ² with as many degrees of freedom as the effect has numbers
        [Wilks 1938]; a walk has one. Every value searched counts as an effect of its own.
        """
        from scipy.stats import chi2

        numbers = 1 if self.paid is not None else max(len(self.new), 1)
        paid = np.log(samples) / 2 if self.paid is not None else self.penalty(samples)
        return float(chi2.isf(CHANCE / (of * self.tried), numbers) / 2 - paid)

    @property
    def free(self) -> bool:
        """Tell whether it is a course in time through three points or more: it can follow anything."""
        return self.course and any(name.endswith("levels.2") for name in self.new)

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
