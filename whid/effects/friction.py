"""Friction beside the declared path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar, NamedTuple

from whid.blocks._block import Block
from whid.blocks.constant import Constant
from whid.blocks.coulomb import Coulomb
from whid.blocks.parallel import Parallel
from whid.blocks.viscous import Viscous
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites


class Term(NamedTuple):
    """One term of it: a block that does nothing yet, and the number that scales it."""

    name: str
    block: Block
    number: str


TERMS = (
    Term("viscous", Viscous(coefficient=0.0), "coefficient"),
    Term("Coulomb", Coulomb(force=0.0, fix=("offset",)), "force"),
    Term("offset", Constant(level=0.0), "level"),
)


@dataclass(frozen=True, kw_only=True)
class Friction(Effect):
    """A path without memory from input to output: y = F(u) + viscous·u + coulomb·sign(u) + offset.

    Its signature, with the input a velocity: a jump where it changes sign, a straight line, a constant.
    """

    places: ClassVar[tuple[Place, ...]] = ("parallel",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield every choice of the three terms: each enters by its own gain."""
        for chosen in (c for count in (1, 2, 3) for c in combinations(TERMS, count)):
            alone = len(chosen) == 1
            edit = sites.along(chosen[0].block if alone else Parallel(parallel=tuple(term.block for term in chosen)))
            names = [term.number if alone else f"parallel.{k}.{term.number}" for k, term in enumerate(chosen)]
            terms = tuple((term.name, (edit.path + name,)) for term, name in zip(chosen, names, strict=True))
            yield edit.candidate(*names, amplitude=tuple(names))._replace(terms=terms)
