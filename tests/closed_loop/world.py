"""What really happens between the input file and the output file: a plant, what is wrong with it, and the noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from tests.closed_loop.fine import FACTOR, Beside, Element, Fine, Floats, Loop, Series, fine
from tests.closed_loop.plan import Plan
from tests.closed_loop.plants import Plant

LEAD = 150  # samples of the first level before the record begins
Change = Callable[[Floats], Floats]


@dataclass(frozen=True)
class World:
    """A row of named elements from the input to the sensor, when the sensor is read, and what it does to what it reads.

    chain      (name, element): "part 0", "part 1" … are the plant's own
    beside     a branch in parallel to all of it
    around     what comes back from its output and is taken off its input
    read       sample numbers → when they were really read, in samples
    sensor     changes of the undisturbed samples, in order
    noise      draws added to the white (or autoregressive) noise, from the undisturbed samples
    converter  changes of the noisy samples, in order
    """

    chain: tuple[tuple[str, Element], ...]
    between: str = "zoh"
    beside: Element | None = None
    around: Element | None = None
    read: Change | None = None
    sensor: tuple[Change, ...] = ()
    noise: tuple[Change, ...] = ()
    converter: tuple[Change, ...] = ()

    @classmethod
    def of(cls, plant: Plant) -> World:
        """Return the plant with nothing wrong."""
        return cls(tuple((f"part {i}", e) for i, e in enumerate(plant.elements())))

    def at(self, name: str) -> int:
        """Return where an element stands."""
        return [n for n, _ in self.chain].index(name)

    def inserted(self, place: int, name: str, element: Element) -> World:
        """Return the world with an element ahead of the one at `place`."""
        return replace(self, chain=(*self.chain[:place], (name, element), *self.chain[place:]))

    def replaced(self, name: str, element: Element) -> World:
        """Return the world with another element in the place of one."""
        return replace(self, chain=tuple((n, element if n == name else e) for n, e in self.chain))

    def undisturbed(self, plan: Plan) -> Floats:
        """Return what the sensor shows without any noise."""
        x = self._read(plan)
        for change in self.sensor:
            x = change(x)
        return x

    def clean(self, plan: Plan) -> Floats:
        """Return what the converter would show without any noise."""
        return self._converted(self.undisturbed(plan))

    def measured(self, plan: Plan, noise: Floats) -> Floats:
        """Return the record's output for a draw of the noise."""
        x = self.undisturbed(plan)
        return self._converted(x + noise + sum((draw(x) for draw in self.noise), np.zeros(len(x))))

    def _converted(self, y: Floats) -> Floats:
        for change in self.converter:
            y = change(y)
        return y

    def _read(self, plan: Plan) -> Floats:
        y = self._tree(fine(np.concatenate([np.full(LEAD, plan.u[0]), plan.u]), plan.dt, self.between))
        if self.read is None:
            return y.start[LEAD * FACTOR :: FACTOR].copy()
        when = (self.read(np.arange(len(plan.u), dtype=float)) + LEAD) * FACTOR
        when = np.clip(when, 0, len(y.start) - 1)
        k = np.minimum(when.astype(int), len(y.start) - 2)
        return y.start[k] + (y.end[k] - y.start[k]) * (when - k)

    def _tree(self, u: Fine) -> Fine:
        tree: Element = Series(tuple(element for _, element in self.chain))
        if self.around is not None:
            tree = Loop(tree, self.around)
        return (Beside(tree, self.beside) if self.beside is not None else tree)(u)


class Noise(NamedTuple):
    """The declared noise: white, or autoregressive with this innovation."""

    std: float
    coefficients: tuple[float, ...] = ()

    def draw(self, samples: int, rng: np.random.Generator) -> Floats:
        """Return a stationary draw."""
        white = self.std * rng.standard_normal(samples + 500)
        return np.asarray(lfilter([1.0], [1.0, *(-a for a in self.coefficients)], white)[500:])

    @property
    def whole(self) -> float:
        """Return the standard deviation of the noise itself, not of its innovation."""
        impulse = lfilter([1.0], [1.0, *(-a for a in self.coefficients)], np.eye(1, 2000)[0])
        return float(self.std * np.sqrt(impulse @ impulse))
