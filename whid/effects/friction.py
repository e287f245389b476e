"""Friction beside the declared path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from whid.blocks.constant import Constant
from whid.blocks.coulomb import Coulomb
from whid.blocks.parallel import Parallel
from whid.blocks.viscous import Viscous
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites


@dataclass(frozen=True, kw_only=True)
class Friction(Effect):
    """A path without memory from input to output: y = F(u) + viscous·u + coulomb·sign(u) + offset.

    Its signature, with the input a velocity: a jump where it changes sign, a straight line, a constant.
    """

    places: ClassVar[tuple[Place, ...]] = ("parallel",)

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield viscous, dry, both, and the offset."""
        viscous, dry, offset = Viscous(coefficient=0.0), Coulomb(force=0.0, fix=("offset",)), Constant(level=0.0)
        for branch, names in ((viscous, ("coefficient",)), (dry, ("force",)), (offset, ("level",))):
            yield sites.along(branch).candidate(*names, amplitude=names)
        both = sites.along(Parallel(parallel=(viscous, dry)))
        numbers = ("parallel.0.coefficient", "parallel.1.force")
        yield both.candidate(*numbers, amplitude=numbers)
