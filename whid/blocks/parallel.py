"""Blocks side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from annotated_types import MinLen

from whid.blocks._block import Block, State, Tangents, each
from whid.blocks._split import total
from whid.blocks._stack import Bundle, stacked
from whid.signal import Signal


@dataclass(frozen=True, kw_only=True)
class Parallel(Block):
    """Branches with the same input, summed: y = b₁(u) + b₂(u) + … + bₙ(u).

         ┌─►[b₁]─┐
    u ───┼─►[b₂]─┼─(+)──► y
         └─►[bₙ]─┘

    Between samples every branch keeps its own switching points. Written `parallel: [...]`; a branch of several blocks is
    a `chain`.

    >>> from whid.blocks.coulomb import Coulomb
    >>> from whid.blocks.viscous import Viscous
    >>> Parallel(parallel=(Viscous(coefficient=2.0), Coulomb(force=1.0)))([-1.0, 0.0, 3.0], dt=1.0)
    array([-3.,  0.,  7.])
    """

    parallel: Annotated[tuple[Block, ...], MinLen(1)]

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Pass the chunk through every branch and add."""
        passed = [block.step(signal, s) for block, s in zip(self.parallel, each(state, len(self.parallel)), strict=True)]
        return total([out for out, _ in passed]), [s for _, s in passed]

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Add the branches' derivatives along the seeds; a number's derivative comes from its own branch."""
        names = [name.split(".", 2) for name in wrt]
        found: list[Signal | None] = [None] * len(wrt)
        passed = []
        for place, (block, s) in enumerate(zip(self.parallel, each(state, len(self.parallel)), strict=True)):
            mine = [j for j, name in enumerate(names) if int(name[1]) == place]
            passed.append(block.tangent(signal, seeds, [names[j][2] for j in mine], s))
            for j, own in zip(mine, passed[-1].tangents[len(seeds) :], strict=True):
                found[j] = own
        along = [total([stacked(p.tangents[: len(seeds)]) for p in passed])] if seeds else []
        rates = [own for own in found if own is not None]
        tangents = Bundle(stacked([*along, *rates])) if seeds or wrt else []
        return Tangents(total([p.signal for p in passed]), tangents, [p.state for p in passed])

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Add the branches' steady levels."""
        levels, states = zip(*(block.steady(level, dt) for block in self.parallel), strict=True)
        return float(sum(levels)), list(states)
