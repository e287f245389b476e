"""Where effects go: the places of a tree, and the edits that put a block there, with the names of its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from whid.blocks._block import Block
from whid.blocks.linear import Linear
from whid.blocks.oversampled import Oversampled
from whid.blocks.parallel import Parallel
from whid.system import System

DYNAMIC = ("linear", "delay")
LAST = ("tone",)  # added behind everything


class Edit(NamedTuple):
    """An edited system and what the names of the new block's numbers begin with."""

    system: System
    path: str


@dataclass(frozen=True)
class Sites:
    """The places of a system's series: linear blocks in front, the nonlinear one, linear blocks behind."""

    system: System

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Return the blocks between input and output."""
        return self.system.series

    @property
    def nonlinear(self) -> list[int]:
        """Return the places of the nonlinear blocks."""
        return [k for k, block in enumerate(self.blocks) if block.kind not in DYNAMIC and not _linear(block)]

    @property
    def front(self) -> int | None:
        """Return the place ahead of the nonlinear block, None where a linear block there would be the back's."""
        return self.nonlinear[0] if self.nonlinear else None

    @property
    def end(self) -> int:
        """Return the place behind the last block."""
        return len(self.blocks)

    def inserted(self, place: int, block: Block) -> Edit:
        """Return the system with a block ahead of the one at a place of the series."""
        chain = (*self.blocks[:place], block, *self.blocks[place:])
        return Edit(self._with(chain), f"{self.system.series_path}{place}.")

    def beside(self, place: int, branch: Block) -> Edit:
        """Return the system with a branch in parallel to the block at a place; a branch already there gets a neighbour."""
        here = self.blocks[place]
        branches = here.parallel if isinstance(here, Parallel) else (here,)
        chain = (*self.blocks[:place], Parallel(parallel=(*branches, branch)), *self.blocks[place + 1 :])
        return Edit(self._with(chain), f"{self.system.series_path}{place}.parallel.{len(branches)}.")

    def replaced(self, place: int, block: Block) -> Edit:
        """Return the system with another block at a place."""
        chain = (*self.blocks[:place], block, *self.blocks[place + 1 :])
        return Edit(self._with(chain), f"{self.system.series_path}{place}.")

    def _with(self, chain: tuple[Block, ...]) -> System:
        tones = tuple(block for block in self.system.chain if block.kind in LAST)
        first = self.system.chain[0]
        if self.system.series_path != "chain." and isinstance(first, Oversampled):
            return replace(self.system, chain=(replace(first, chain=chain), *tones))
        return replace(self.system, chain=(*chain, *tones))


def _linear(block: Block) -> bool:
    return isinstance(block, Linear) or (bool(block.children()) and all(_linear(child) for child in block.children()))


def walked(block: Block, path: str = "") -> Iterator[tuple[str, Block]]:
    """Yield every block of a tree with the beginning of its numbers' names."""
    yield path, block
    for name, child in block.named_children():
        yield from walked(child, f"{path}{name}.")
