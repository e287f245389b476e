"""Blocks at a multiple of the record's rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, MinLen

from whid.blocks._block import Block, State, Tangents
from whid.blocks._split import value_at
from whid.blocks.chain import Chain
from whid.signal import Signal

NODES = 12  # an interval: half a turn, the fastest a band-limited signal can go, is met to 1e-9


@dataclass(frozen=True, kw_only=True)
class Oversampled(Block):
    """A chain of sampled blocks that runs `factor` times faster than the record around it.

    u ──►[ ↑ factor ]──►[b₁]── … ──►[bₙ]──►[ ↓ factor ]──► y

    A curve between digital filters makes harmonics that fold back at half the sampling rate, which those of an analogue
    plant never do; at twice the rate they find room. The input between samples is taken from its course (band-limited,
    straight, held; on the sampled path held), the output is every factor-th sample, held. Discrete blocks inside have
    dt/factor for their dt.

    >>> from whid.blocks.linear import Linear
    >>> delay = Linear(num=(0.0, 1.0), den=(1.0, 0.0), dt=0.25)
    >>> Oversampled(factor=2, chain=(delay,))([1.0, 3.0, 5.0], dt=0.5, between="discrete")
    array([0., 1., 3.])
    """

    factor: Annotated[int, Ge(2)]
    chain: Annotated[tuple[Block, ...], MinLen(1)]

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Run the chain over the finer samples."""
        out, state = self._inner.step(finer(signal, self.factor), state)
        return self._thinned(out, signal), state

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Run the chain's tangents over the finer samples."""
        fine = [finer(seed, self.factor) for seed in seeds]
        out, tangents, state = self._inner.tangent(finer(signal, self.factor), fine, wrt, state)
        return Tangents(self._thinned(out, signal), [self._thinned(t, signal) for t in tangents], state)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the chain's level."""
        return self._inner.steady(level, dt / self.factor)

    def panel_order(self, dt: float) -> int:
        """Return what a band-limited input needs."""
        return NODES

    @property
    def _inner(self) -> Chain:
        return Chain(chain=self.chain)

    def _thinned(self, out: Signal, signal: Signal) -> Signal:
        return signal.with_values(out.values[:: self.factor], "discrete" if signal.sampled else "zoh")


def finer(signal: Signal, factor: int) -> Signal:
    """Return samples of a signal at a multiple of its rate, read off its course between samples.

    >>> from whid.signal import held
    >>> finer(held([0.0, 1.0, 1.0], 1.0, "foh"), 2).values.round(9)
    array([0. , 0.5, 1. , 1. , 1. , 1. ])
    """
    values = np.repeat(np.asarray(signal.values, float), factor)
    if callable(signal.between):
        every = np.arange(len(signal.values))
        for place in range(1, factor):
            values[place::factor] = value_at(signal.panels, every, np.full(len(every), place / factor))
    return Signal(values, signal.dt / factor, signal.t0, "discrete", signal.order)
