"""Relay with hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from whid.blocks._block import Block, Free, State, Tangents
from whid.blocks._split import NO_CROSSINGS, Crossings, onto, split, value_at
from whid.errors import WhidError
from whid.signal import NO_IMPULSES, Floats, Impulses, Panels, Signal


@dataclass(frozen=True, kw_only=True)
class Relay(Block):
    """A switch that goes on at high and off at low, and in between stays as it was.

    w = on once v ≥ high, off once v < low, otherwise as before; at first off

          w   ┌───◄─►── on
              │    │
    ──────────┼────┼───► v
     off ──◄─►┘    │
             low  high

    low, high in input units, on, off in output units; low = high has no hysteresis. Between samples it switches when v
    crosses. State: on or off. Raises `WhidError("block-parameters")` if low > high.

    >>> Relay(low=-0.5, high=0.5)([0.0, 1.0, 0.0, -1.0, 0.0], dt=1.0)
    array([-1.,  1.,  1., -1., -1.])
    """

    low: Annotated[float, Free("input")]
    high: Annotated[float, Free("input")]
    off: Annotated[float, Free("output")] = -1.0
    on: Annotated[float, Free("output")] = 1.0

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise WhidError("block-parameters", f"relay needs low <= high, not {self.low:g} > {self.high:g}")

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Switch at the samples and, where the signal lives between them, at its crossings."""
        run = _Run(self, signal, state is True)
        return run.output(self.off, self.on), run.last

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Return 0 along every seed but for the impulses where a switching moves in time; off and on act where they hold."""
        run = _Run(self, signal, state is True)
        along = [run.moved(seed, "") for seed in seeds] + [run.moved(None, name) for name in wrt]
        return Tangents(run.output(self.off, self.on), along, run.last)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return on at or above high, off below (between the two, where it has always been off)."""
        on = level >= self.high
        return (self.on if on else self.off), on


class _Run:
    """One chunk: when the relay is on."""

    def __init__(self, relay: Relay, signal: Signal, state: bool) -> None:
        self.relay, self.signal = relay, signal
        inner = callable(signal.between)
        self.panels, self.crossings = _course(relay, signal) if inner else (signal.panels, NO_CROSSINGS)
        s, n = self.panels.splits, len(signal.values)
        whole = np.ones(n, bool)
        whole[s.interval] = False
        dense = np.flatnonzero(whole) if inner else np.empty(0, np.intp)
        middle = (len(self.panels.values) - 1) // 2
        values = [signal.values, self.panels.values[middle, dense], s.values[middle] if len(s.interval) else s.start]
        index = np.concatenate([np.arange(n), dense, s.interval])
        order = np.lexsort((np.concatenate([np.full(n, -1.0), np.zeros(len(dense)), s.start]), index))
        on = np.empty(len(order), bool)
        on[order] = _latched(np.concatenate(values)[order], relay, state)
        self.last = bool(on[order[-1]]) if len(order) else state
        self.at_samples, self.at_dense, self.at_splits = np.split(on, [n, n + len(dense)])
        self.dense = dense

    def output(self, off: float, on: float) -> Signal:
        """Return a signal that is `off` or `on`."""
        values = np.where(self.at_samples, on, off).astype(float)
        if not callable(self.signal.between):
            return self.signal.with_values(values)
        level = np.full(len(values), off)
        level[self.dense] = np.where(self.at_dense, on, off)
        q, s = len(self.panels.values), self.panels.splits
        if len(s.interval):
            s = s._replace(values=np.tile(np.where(self.at_splits, on, off).astype(float), (q, 1)))
        return self.signal.with_values(values, lambda: Panels(np.tile(level, (q, 1)), s))

    def moved(self, seed: Signal | None, name: str) -> Signal:
        """Return the derivative: impulses (on − off)·(dv − db)/|v̇| at the switchings, and where off or on act."""
        out = self.output(float(name == "off"), float(name == "on"))
        if not callable(self.signal.between):
            return out
        s = self.panels.splits
        c = self._switchings(self.crossings)
        moved = np.zeros(len(c.at)) if seed is None else value_at(onto(seed, s), c.interval, c.at)
        moved = moved - (c.which == (0 if name == "low" else 1)) * (name in ("low", "high"))
        area = (self.relay.on - self.relay.off) * moved / c.speed * self.signal.dt
        impulses = Impulses(c.interval, c.at, area) if len(c.at) else NO_IMPULSES
        panels = out.panels._replace(impulses=impulses)
        return out.with_values(out.values, lambda: panels)

    def _switchings(self, crossings: Crossings) -> Crossings:
        """Return the crossings at which the relay did switch: on at high, off at low."""
        s = self.panels.splits
        after = np.searchsorted(s.interval + s.start, crossings.interval + crossings.at + 1e-9, side="right") - 1
        before = np.searchsorted(s.interval + s.start, crossings.interval + crossings.at - 1e-9, side="right") - 1
        return crossings.where((self.at_splits[after] != self.at_splits[before]) & (crossings.speed > 0))


def _course(relay: Relay, signal: Signal) -> tuple[Panels, Crossings]:
    return split(signal, np.array([relay.low, relay.high]))


def _latched(v: Floats, relay: Relay, state: bool) -> np.ndarray:
    """Return on or off after every value, in time order."""
    decided = (v >= relay.high) | (v < relay.low)
    latest = np.maximum.accumulate(np.where(decided, np.arange(len(v)), -1))
    return np.where(latest >= 0, v[latest] >= relay.high, state)
