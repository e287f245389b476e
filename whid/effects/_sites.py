"""Where effects go: the places of a tree, and the edits that put a block there, with the names of its numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.blocks._static import Static
from whid.blocks.chain import Chain
from whid.blocks.feedback import Feedback
from whid.blocks.linear import Linear
from whid.blocks.oversampled import Oversampled
from whid.blocks.parallel import Parallel
from whid.effects._candidate import Candidate
from whid.system import System

DYNAMIC = ("linear", "delay")
FAR = 1e9  # in units of anything: where a clip is flat
Core = tuple[int, int]  # where in the series the declared blocks begin and end: what stands outside was added


class Edit(NamedTuple):
    """An edited system, what the names of the new block's numbers begin with, and where the declared blocks are now."""

    system: System
    path: str
    core: Core

    def candidate(
        self, *names: str, amplitude: tuple[str, ...] = (), rough: tuple[tuple[str, float], ...] = (), tried: int = 1
    ) -> Candidate:
        """Return the candidate whose new numbers these are, named as in the new block."""
        new, scaled = (tuple(self.path + name for name in each) for each in (names, amplitude))
        searched = tuple((self.path + name, reach) for name, reach in rough)
        return Candidate(self.system, self.core, new, scaled, searched, tried)


@dataclass(frozen=True)
class Sites:
    """The places of a system's series: what was declared, and what was added before and behind it."""

    system: System
    core: Core

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Return the blocks between input and output."""
        return self.system.series

    @property
    def end(self) -> int:
        """Return the place behind the last block."""
        return len(self.blocks)

    @property
    def nonlinear(self) -> list[int]:
        """Return the places of the declared blocks that are not linear."""
        return [k for k in range(*self.core) if not _linear(self.blocks[k])]

    @property
    def railed(self) -> bool:
        """Tell whether the last block is a static curve that is constant far out: the output has rails of its own."""
        last = self.blocks[-1]
        return isinstance(last, Static) and bool(np.any(last.derivative(np.array([-FAR, FAR])) == 0))

    @property
    def moving(self) -> bool:
        """Tell whether the declared blocks have a memory."""
        return not all(instant(block) for block in self.blocks[slice(*self.core)])

    @property
    def looped(self) -> bool:
        """Tell whether something comes back already: a second way back beside the first would be the same loop."""
        return any(isinstance(block, Feedback) for block in self.blocks[slice(*self.core)])

    @property
    def static(self) -> list[int]:
        """Return the places of the declared static curves."""
        inner = (Static, Parallel)
        return [k for k in self.nonlinear if isinstance(self.blocks[k], inner) and instant(self.blocks[k])]

    @property
    def front(self) -> int | None:
        """Return the place of a linear block in front: ahead of the curve, between two curves, behind a linear chain."""
        curves = self.nonlinear
        if not curves:
            return self.core[1]
        between = len(curves) > 1 and curves[0] == self.core[0]
        return curves[1] if between else curves[0]

    @property
    def back(self) -> int | None:
        """Return the place of a linear block behind the curve, None where that is no other place than in front."""
        curves = self.nonlinear
        return self.core[1] if curves and (curves[-1] < self.core[1] - 1 or len(curves) == 1) else None

    def inserted(self, place: int, block: Block, *, inside: bool = False) -> Edit:
        """Return the system with a block ahead of the one at a place; `inside`: among the declared blocks."""
        chain = (*self.blocks[:place], block, *self.blocks[place:])
        first, last = self.core
        before = place < first or (place == first and not inside)
        core = (first + 1, last + 1) if before else (first, last + 1 if place < last or inside else last)
        return Edit(self._with(chain), f"{self.system.series_path}{place}.", core)

    def beside(self, place: int, branch: Block) -> Edit:
        """Return the system with a branch in parallel to the block at a place; a branch already there gets a neighbour."""
        here = self.blocks[place]
        branches = here.parallel if isinstance(here, Parallel) else (here,)
        chain = (*self.blocks[:place], Parallel(parallel=(*branches, branch)), *self.blocks[place + 1 :])
        return Edit(self._with(chain), f"{self.system.series_path}{place}.parallel.{len(branches)}.", self.core)

    def replaced(self, place: int, block: Block) -> Edit:
        """Return the system with another block at a place."""
        chain = (*self.blocks[:place], block, *self.blocks[place + 1 :])
        return Edit(self._with(chain), f"{self.system.series_path}{place}.", self.core)

    @property
    def declared(self) -> Block:
        """Return the declared blocks as one."""
        first, last = self.core
        return self.blocks[first] if last - first == 1 else Chain(chain=self.blocks[first:last])

    def around(self, block: Block) -> Edit:
        """Return the system with one block, which holds the declared ones, in their place."""
        first, last = self.core
        chain = (*self.blocks[:first], block, *self.blocks[last:])
        return Edit(self._with(chain), f"{self.system.series_path}{first}.", (first, first + 1))

    def along(self, branch: Block) -> Edit:
        """Return the system with a branch in parallel to all the declared blocks."""
        here = self.declared
        branches = here.parallel if isinstance(here, Parallel) else (here,)
        edit = self.around(Parallel(parallel=(*branches, branch)))
        return edit._replace(path=f"{edit.path}parallel.{len(branches)}.")

    def added(self, tone: Block) -> Edit:
        """Return the system with a tone behind everything."""
        chain = (*self.system.chain, tone)
        return Edit(replace(self.system, chain=chain), f"chain.{len(chain) - 1}.", self.core)

    def _with(self, chain: tuple[Block, ...]) -> System:
        tones = tuple(block for block in self.system.chain if block.kind == "tone")
        first = self.system.chain[0]
        if self.system.series_path != "chain." and isinstance(first, Oversampled):
            return replace(self.system, chain=(replace(first, chain=chain), *tones))
        return replace(self.system, chain=(*chain, *tones))


def _linear(block: Block) -> bool:
    inside = block.children()
    return block.kind in DYNAMIC or isinstance(block, Linear) or (bool(inside) and all(_linear(child) for child in inside))


def instant(block: Block) -> bool:
    """Tell whether a block has no memory, nor any inside it."""
    inside = block.children()
    return all(instant(child) for child in inside) if inside else isinstance(block, Static)
