"""Pure delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from whid.blocks._block import STEADY, Block, Free, State, Tangents
from whid.blocks._split import refined, value_at
from whid.signal import NO_IMPULSES, Between, Floats, Impulses, Panels, Signal, Splits, held, joined, rule


@dataclass(frozen=True, kw_only=True)
class Delay(Block):
    """The same signal, later.

    w(t) = v(t − seconds)

    v ──►│ e^(−s·seconds) │──► w

    seconds ≥ 0, any fraction of a sample. Between samples the delayed course is exact: every interval is split where an
    interval of v begins, which costs some ten times a filter of the same length. On the sampled path v is taken to be
    straight between its samples. State: the last ⌈seconds/dt⌉ intervals.

    >>> Delay(seconds=0.5)([1.0, 2.0, 3.0, 4.0], dt=0.25)
    array([0., 0., 1., 2.])
    """

    seconds: Annotated[float, Free("s", 0.0), Ge(0)]

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Put the past before the chunk and read it later."""
        lag = _Lag.of(self.seconds, signal)
        past = state if isinstance(state, Signal) else lag.past(signal, state)
        return lag.read(joined(past, signal), exact=False), lag.kept(past, signal)

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Delay the seeds as well; with respect to the delay it is −dv/dt, the jumps of v as impulses."""
        lag = _Lag.of(self.seconds, signal)
        start = state if isinstance(state, tuple) else (lag.past(signal, state), [lag.past(seed, state) for seed in seeds])
        past, seeds_past = start
        exact = bool(wrt) and not signal.sampled  # impulses need the borders of the panels even where nothing is cut
        whole = joined(past, signal)
        along = [lag.read(joined(p, seed), exact) for p, seed in zip(seeds_past, seeds, strict=True)]
        rates = [lag.read(whole, exact, rate=True) for _ in wrt]
        kept = [lag.kept(p, seed) for p, seed in zip(seeds_past, seeds, strict=True)]
        return Tangents(lag.read(whole, exact), along + rates, (lag.kept(past, signal), kept))

    def gain_at(self, omega: Floats) -> NDArray[np.complex128]:
        """Return exp(−jω·seconds); omega in rad/s, any shape."""
        return np.asarray(np.exp(-1j * np.asarray(omega) * self.seconds))

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the level: it has been there for ever."""
        samples = _Lag.of(self.seconds, held(np.empty(0), dt, "zoh")).samples
        return level, held(np.full(samples, level), dt, "zoh", -samples * dt)


@dataclass(frozen=True)
class _Lag:
    """A delay on a grid: `samples` intervals of past, less `early` of one."""

    samples: int
    early: float  # in (0, 1]: the fraction of an interval by which the delay falls short of `samples`
    dt: float

    @classmethod
    def of(cls, seconds: float, signal: Signal) -> _Lag:
        samples = int(np.floor(seconds / signal.dt + 1e-9)) + 1
        return cls(samples, min(1.0, samples - seconds / signal.dt), signal.dt)

    def past(self, signal: Signal, state: State) -> Signal:
        """Return a past of rest, or (STEADY) of the signal's first value."""
        level = signal.values[0] if state == STEADY and len(signal.values) else 0.0
        between: Between = "discrete" if signal.sampled else "zoh"
        return Signal(np.full(self.samples, level), self.dt, signal.t0 - self.samples * self.dt, between, signal.order)

    def kept(self, past: Signal, signal: Signal) -> Signal:
        """Return the past of the next chunk, its panels made now so that no older chunk is kept alive."""
        tail = joined(past, signal)[len(signal.values) :]
        if not callable(tail.between):
            return tail
        panels = tail.panels
        return tail.with_values(tail.values, lambda: panels)

    def read(self, v: Signal, exact: bool, rate: bool = False) -> Signal:
        """Return v, or −dv/dt, delayed: v begins `samples` intervals before the output."""
        n = len(v.values) - self.samples
        t0 = v.t0 + self.samples * self.dt
        if not exact and not rate and self.early == 1:
            return replace(v[1 : n + 1], t0=t0)
        if v.sampled:
            first, second = v.values[:n], v.values[1 : n + 1]
            values = (first - second) / self.dt if rate else first + self.early * (second - first)
            return Signal(np.asarray(values), self.dt, t0, "discrete", v.order)
        course = _slopes(v.panels, self.dt) if rate else v.panels
        samples = _at_start(course, self.early, n)
        return Signal(samples, self.dt, t0, lambda: self._shifted(v.panels, course, n, rate), v.order)

    def _shifted(self, v: Panels, course: Panels, n: int, rate: bool) -> Panels:
        """Return the course on its own panels, each cut where an interval of the output begins."""
        pieces = _cut(course, self.early)
        late = pieces.start >= self.early - 1e-12  # belongs to the interval with its own number, the rest to the one before
        index = np.where(late, pieces.interval, pieces.interval - 1)
        start = np.where(late, pieces.start - self.early, pieces.start - self.early + 1)
        inside = (index >= 0) & (index < n)
        splits = Splits(index[inside], np.clip(start[inside], 0, 1), pieces.width[inside], pieces.values[:, inside])
        moved = self._impulses(course.impulses, n)
        if rate:
            moved = _both(moved, self._impulses(_jumps(v), n))
        dense = _at_start(course, self.early, n)
        return Panels(np.tile(dense, (len(course.values), 1)), splits, moved)

    def _impulses(self, i: Impulses, n: int) -> Impulses:
        when = i.interval + i.at - self.early
        index = np.floor(when).astype(np.intp)
        inside = (index >= 0) & (index < n)
        return Impulses(index[inside], (when - index)[inside], i.area[inside])


def _cut(course: Panels, where: float) -> Splits:
    """Return every interval of a course as sub-panels, cut at one place of each."""
    q, count = course.values.shape
    marks = [np.zeros(count), np.full(count, where)] if 0 < where < 1 else [np.zeros(count)]
    index, start = np.tile(np.arange(count), len(marks)), np.concatenate(marks)
    index, start = np.append(index, course.splits.interval), np.append(start, course.splits.start)
    order = np.lexsort((start, index))
    index, start = index[order], start[order]
    last = np.append(index[1:] != index[:-1], True)
    width = np.where(last, 1.0, np.append(start[1:], 1.0)) - start
    wide = width > 1e-13
    s = Splits(index[wide], start[wide], width[wide], np.empty((q, 0)))
    return s._replace(values=refined(course, s))


def _at_start(course: Panels, early: float, n: int) -> Floats:
    """Return the value of every interval at one place, from the right."""
    return value_at(course, np.arange(n) + int(early), np.full(n, early % 1))


def _slopes(v: Panels, dt: float) -> Panels:
    """Return −dv/dt, and −its impulses (their slopes are not signals any more) left out."""
    s = v.splits
    inner = s._replace(values=-_slope(s.values) / (s.width * dt)) if len(s.interval) else s
    return Panels(-_slope(v.values) / dt, inner, NO_IMPULSES)


def _slope(values: Floats) -> Floats:
    legendre = np.polynomial.legendre
    q = len(values)
    slope = 2 * legendre.legder(rule(q).to_legendre @ values, axis=0)
    return np.asarray(legendre.legvander(2 * rule(q).nodes - 1, len(slope) - 1) @ slope)


def _jumps(v: Panels) -> Impulses:
    """Return −jump of v at every border of its panels, as impulses."""
    pieces = _cut(v, 0.0)
    ends = rule(len(pieces.values)).ends @ pieces.values
    jump = ends[0, 1:] - ends[1, :-1]
    hit = np.flatnonzero(jump)
    return Impulses(pieces.interval[hit + 1], pieces.start[hit + 1], -jump[hit])


def _both(a: Impulses, b: Impulses) -> Impulses:
    return Impulses(np.append(a.interval, b.interval), np.append(a.at, b.at), np.append(a.area, b.area))
