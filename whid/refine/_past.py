"""What stands for an unknown past: held levels of the input that explain the first samples best."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.fit import minimise
from whid.record import Record
from whid.refine._free import FreeNumbers
from whid.refine._problem import Data, Problem
from whid.signal import Floats, Signal

ENOUGH = 20  # steps: the levels come in linearly but for the curve


class Past(NamedTuple):
    """A record's input before it began: levels (k,) held over `data.past` samples, oldest first; none: no unknown past."""

    data: Data
    levels: Floats

    @property
    def lead(self) -> int:
        """Return how many samples stand before the record."""
        return self.data.lead

    def joined(self, u: Signal) -> Signal:
        """Return an input with the past before it."""
        return self.data.begun(u, self.levels)

    def seeds(self, u: Signal) -> list[Signal]:
        """Return the derivative of a joined input with respect to every level."""
        return self.data.seeds(u)


def past(tree: Block, record: Record, path: str = "exact") -> Past:
    """Return the past of a record whose initial state is free: min Σ (y − ŷ)² over its levels, the tree held; else none.

    >>> from whid.blocks.linear import Linear
    >>> lag = Linear(num=(1.0,), den=(1.0, 1.0))
    >>> u = np.append(np.full(40, 3.0), np.zeros(20))
    >>> late = Record(u=u[40:], y=lag(u, 0.5)[40:], dt=0.5, initial="free")
    >>> past(lag, late).levels.round(4), past(lag, Record(u=u, y=u, dt=0.5)).lead
    (array([3.]), 0)
    """
    data = Data.of(record, tree)
    if not data.past or not data.use.any():
        return Past(replace(data, past=()), np.empty(0))
    problem = Problem(FreeNumbers(tree, tuple(p.name for p in tree.parameters(held=True))), (data,), path)
    fit = minimise(problem.cost, problem.linearise, problem.parameters, known=False, max_iterations=ENOUGH)
    return Past(data, fit.values)
