"""Tangents side by side: as many signals on one grid as there are, in one array, so that a block takes them all at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np

from whid.blocks._split import refined, united
from whid.signal import NO_IMPULSES, Between, Impulses, Panels, Signal


class Bundle(Sequence[Signal]):
    """A sequence of signals that are kept as one `Signal` whose arrays have a leading axis.

    A block that does not know of it sees signals one by one.

    >>> pair = Bundle(Signal(np.array([[1.0, 2.0], [3.0, 4.0]]), 0.1))
    >>> len(pair), pair[1].values
    (2, array([3., 4.]))
    """

    def __init__(self, stack: Signal) -> None:
        self.stack = stack

    def __len__(self) -> int:
        return len(self.stack.values)

    @overload
    def __getitem__(self, which: int) -> Signal: ...
    @overload
    def __getitem__(self, which: slice) -> Bundle: ...
    def __getitem__(self, which: int | slice) -> Signal | Bundle:
        if isinstance(which, slice):
            return Bundle(_rows(self.stack, which))
        if not -len(self) <= which < len(self):
            raise IndexError(which)
        return _rows(self.stack, which)

    def ordered(self, order: Sequence[int]) -> Bundle:
        """Return the signals in another order."""
        return self if list(order) == list(range(len(self))) else Bundle(_rows(self.stack, np.array(order, np.intp)))


def stacked(signals: Sequence[Signal]) -> Signal:
    """Return signals on one grid, single ones and stacks, as one stack (p, N), on the union of their splits.

    >>> stacked([Signal(np.zeros(2), 0.1), Signal(np.ones((2, 2)), 0.1)]).values
    array([[0., 0.],
           [1., 1.],
           [1., 1.]])
    """
    if isinstance(signals, Bundle):
        return signals.stack
    if len(signals) == 1 and signals[0].values.ndim == 2:
        return signals[0]
    values = np.concatenate([s.values if s.values.ndim == 2 else s.values[None] for s in signals])
    inner = next((s for s in signals if callable(s.between)), None)
    between: Between = signals[0].between if inner is None else lambda: _beside([s.panels for s in signals])
    like = inner or signals[0]
    return Signal(values, like.dt, like.t0, between, like.order)


def _beside(courses: Sequence[Panels]) -> Panels:
    s = united([course.splits for course in courses])
    dense = np.concatenate([c.values if c.values.ndim == 3 else c.values[None] for c in courses])
    if len(s.interval):
        inner = [refined(course, s) for course in courses]
        s = s._replace(values=np.concatenate([v if v.ndim == 3 else v[None] for v in inner]))
    return Panels(dense, s, _impulses(courses))


def _impulses(courses: Sequence[Panels]) -> Impulses:
    """Return the impulses of every row: those of one course at the places of another have no area."""
    given = [c.impulses for c in courses if len(c.impulses.at)]
    if not given:
        return NO_IMPULSES
    ends = np.cumsum([0, *(len(i.at) for i in given)])
    area, first, k = np.zeros((sum(_count(c) for c in courses), ends[-1])), 0, 0
    for course in courses:
        rows = slice(first, first + _count(course))
        first = rows.stop
        if len(course.impulses.at):
            area[rows, ends[k] : ends[k + 1]] = course.impulses.area
            k += 1
    return Impulses(np.concatenate([i.interval for i in given]), np.concatenate([i.at for i in given]), area)


def _count(course: Panels) -> int:
    return len(course.values) if course.values.ndim == 3 else 1


def _rows(stack: Signal, which: Any) -> Signal:
    def between() -> Panels:
        p = stack.panels
        s = p.splits._replace(values=p.splits.values[which]) if len(p.splits.interval) else p.splits
        i = p.impulses._replace(area=p.impulses.area[which]) if len(p.impulses.at) else p.impulses
        return Panels(p.values[which], s, i)

    return stack.with_values(stack.values[which], between if callable(stack.between) else None)
