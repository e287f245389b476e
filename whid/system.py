"""System: a chain of blocks and its disturbances; a plant, a model and a refined model are all one of these."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from annotated_types import MinLen

from whid.blocks._block import Block
from whid.blocks.chain import Chain
from whid.blocks.parallel import Parallel
from whid.disturbances._disturbance import Disturbance


@dataclass(frozen=True, kw_only=True)
class System:
    """What a study's `plant:` and `model:` hold: `chain:` of blocks, and `noise:` (none, one or a list)."""

    chain: Annotated[tuple[Block, ...], MinLen(1)]
    noise: tuple[Disturbance, ...] = ()

    @property
    def tree(self) -> Chain:
        """Return the chain as one block."""
        return Chain(chain=self.chain)

    @property
    def series(self) -> tuple[Block, ...]:
        """Return the blocks between input and output, seen through what runs them faster; tones added last are left out.

        >>> from whid.blocks.oversampled import Oversampled
        >>> from whid.blocks.viscous import Viscous
        >>> System(chain=(Oversampled(factor=2, chain=(Viscous(coefficient=2.0),)),)).series[0].kind
        'viscous'
        """
        chain = tuple(block for block in self.chain if block.kind != "tone")
        return chain[0].children() if self._wrapped else chain

    @property
    def series_path(self) -> str:
        """Return what the parameter names of `series` begin with."""
        return "chain.0.chain." if self._wrapped else "chain."

    @property
    def _wrapped(self) -> bool:
        return [block.kind for block in self.chain if block.kind != "tone"] == ["oversampled"]

    def inserted(self, place: int, block: Block) -> System:
        """Return the system with a block ahead of the one at `place` (len(chain): behind the last)."""
        return replace(self, chain=(*self.chain[:place], block, *self.chain[place:]))

    def replaced(self, place: int, block: Block) -> System:
        """Return the system with another block at `place`; wrapping one is replacing it by a block that holds it."""
        return replace(self, chain=(*self.chain[:place], block, *self.chain[place + 1 :]))

    def beside(self, branch: Block) -> System:
        """Return the system with a branch in parallel to the whole chain.

        >>> from whid.blocks.constant import Constant
        >>> from whid.blocks.linear import Linear
        >>> plain = System(chain=(Linear(num=(2.0,), den=(1.0,)),))
        >>> plain.beside(Constant(level=3.0)).tree([1.0, 2.0], dt=1.0)
        array([5., 7.])
        """
        return replace(self, chain=(Parallel(parallel=(self.tree, branch)),))

    def disturbed(self, noise: Disturbance) -> System:
        """Return the system with one more disturbance."""
        return replace(self, noise=(*self.noise, noise))
