"""System: a chain of blocks and its disturbances; a plant, a model and a refined model are all one of these."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import MinLen

from whid.blocks._block import Block
from whid.blocks.chain import Chain
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
