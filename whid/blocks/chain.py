"""Blocks one after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from annotated_types import MinLen

from whid.blocks._block import Block, State, Tangents, each
from whid.blocks._stack import Bundle, stacked
from whid.signal import Signal


@dataclass(frozen=True, kw_only=True)
class Chain(Block):
    """Blocks in series: y = bₙ(… b₂(b₁(u))).

    u ──►[b₁]──►[b₂]── … ──►[bₙ]──► y

    The signal keeps its course between samples on the way, so a hard nonlinearity between two linear blocks is met
    exactly where it switches. Written `chain: [...]`.

    >>> from whid.blocks.dead_zone import DeadZone
    >>> from whid.blocks.linear import Linear
    >>> lag = Linear(num=(1.0,), den=(1.0, 1.0))
    >>> Chain(chain=(lag, DeadZone(low=-0.5, high=0.5)))([1.0, 1.0, 1.0], dt=1.0).round(3)
    array([0.   , 0.132, 0.365])
    """

    chain: Annotated[tuple[Block, ...], MinLen(1)]

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Pass the chunk through every block in turn."""
        states = []
        for block, s in zip(self.chain, each(state, len(self.chain)), strict=True):
            signal, s = block.step(signal, s)
            states.append(s)
        return signal, states

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Pass the tangents on: each block adds those of its own numbers, only what is downstream is simulated."""
        names = [name.split(".", 2) for name in wrt]
        order = sorted(range(len(wrt)), key=lambda j: int(names[j][1]))
        states, tangents = [], seeds
        for place, (block, s) in enumerate(zip(self.chain, each(state, len(self.chain)), strict=True)):
            own = [names[j][2] for j in order if int(names[j][1]) == place]
            signal, tangents, s = block.tangent(signal, tangents, own, s)
            states.append(s)
        found = {j: len(seeds) + k for k, j in enumerate(order)}
        whole = [*range(len(seeds)), *(found[j] for j in range(len(wrt)))]
        return Tangents(signal, Bundle(stacked(tangents)).ordered(whole) if whole else [], states)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Pass the level through every block."""
        states = []
        for block in self.chain:
            level, state = block.steady(level, dt)
            states.append(state)
        return level, states
