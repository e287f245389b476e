"""What a whole-record fit may change: the tree's free numbers, some held, some tied, pieces that meet kept together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.blocks.piecewise import Piecewise
from whid.errors import WhidError
from whid.fit import Parameter
from whid.signal import Floats


class Kink(NamedTuple):
    """A break at which the pieces of a `Piecewise` meet: the constant of its right piece follows from the rest."""

    path: str
    number: int

    @property
    def follows(self) -> str:
        """Return the name of the constant that is no number of its own."""
        return f"{self.path}pieces.{self.number + 1}.0"


@dataclass(frozen=True, eq=False)
class FreeNumbers:
    """θ ↔ the tree.

    tree   start values
    held   names that stay, or beginnings of names (`chain.0`, `chain.0.den`)
    tied   groups of names that keep one common value
    """

    tree: Block
    held: tuple[str, ...] = ()
    tied: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        known = {p.name for p in self.tree.parameters(held=True)}
        for name in self.held:
            if not any(_within(each, name) for each in known):
                raise WhidError("fit-parameter", f"no number {name!r} in the model; it has {', '.join(sorted(known))}")
        for name in (name for group in self.tied for name in group):
            if name not in known:
                raise WhidError("fit-parameter", f"cannot tie {name!r}: the model has {', '.join(sorted(known))}")

    @cached_property
    def all(self) -> tuple[Parameter, ...]:
        """Return every number that moves, those that follow from others included."""
        return tuple(p for p in self.tree.parameters() if not any(_within(p.name, name) for name in self.held))

    @cached_property
    def kinks(self) -> tuple[Kink, ...]:
        """Return the borders at which pieces meet, left to right, where the right piece is free to follow."""
        names = {p.name for p in self.all}
        return tuple(kink for kink in _kinks(self.tree) if kink.follows in names)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return θ: one number a tie, none for the constant right of a kink."""
        drop = {name for group in self.tied for name in group[1:]} | {kink.follows for kink in self.kinks}
        return tuple(p for p in self.all if p.name not in drop)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of `all`."""
        return tuple(p.name for p in self.all)

    @cached_property
    def plain(self) -> bool:
        """Tell whether θ is all that moves: no ties, no kinks."""
        return self.names == tuple(p.name for p in self.parameters)

    @cached_property
    def _start(self) -> dict[str, float]:
        return {p.name: p.value for p in self.tree.parameters(held=True)}

    @cached_property
    def _latest(self) -> dict[bytes, Block]:
        return {}

    def at(self, theta: Floats) -> Block:
        """Return the tree at θ."""
        key = theta.tobytes()
        if key not in self._latest:  # a step is tried, then linearised
            self._latest.clear()
            values = dict(zip(self.names, self.expanded(theta)[0].tolist(), strict=True))
            self._latest[key] = self.tree.with_parameters(values)
        return self._latest[key]

    def expanded(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return all numbers (n,) and their derivative with respect to θ (n, p)."""
        if self.plain:
            return theta, np.eye(len(theta))
        values = dict(self._start)
        own = [p.name for p in self.parameters]
        rows: dict[str, Floats] = dict(zip(own, np.eye(len(own)), strict=True))
        values |= dict(zip(own, theta.tolist(), strict=True))
        for first, *rest in self.tied:
            for name in rest:
                values[name], rows[name] = values[first], rows.get(first, np.zeros(len(own)))
        for kink in self.kinks:
            values[kink.follows], rows[kink.follows] = _follow(kink, values, rows, len(own))
        return np.array([values[name] for name in self.names]), np.array([rows[name] for name in self.names])


def _within(name: str, beginning: str) -> bool:
    return name == beginning or name.startswith(f"{beginning}.")


def _kinks(tree: Block) -> Iterator[Kink]:
    for path, block in walk(tree):
        if isinstance(block, Piecewise):
            yield from (Kink(path, int(k)) for k in np.flatnonzero(block.kinks()))


def walk(block: Block, path: str = "") -> Iterator[tuple[str, Block]]:
    """Yield every block of a tree with the beginning of its parameters' names: ("chain.0.", front) and so on."""
    yield path, block
    for name, child in block.named_children():
        yield from walk(child, f"{path}{name}.")


def _follow(kink: Kink, values: dict[str, float], rows: dict[str, Floats], p: int) -> tuple[float, Floats]:
    """Return the right piece's constant that makes both pieces meet at the break, and its derivative."""
    at = f"{kink.path}breaks.{kink.number}"
    b, total, slope, rate = values[at], 0.0, 0.0, np.zeros(p)
    for piece, sign in ((kink.number, 1.0), (kink.number + 1, -1.0)):
        power = 0 if sign > 0 else 1
        while (name := f"{kink.path}pieces.{piece}.{power}") in values:
            total += sign * values[name] * b**power
            slope += sign * values[name] * power * b ** max(power - 1, 0)
            rate = rate + sign * b**power * rows.get(name, np.zeros(p))
            power += 1
    return total, rate + slope * rows.get(at, np.zeros(p))
