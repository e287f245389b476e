"""An actuator that cannot move faster than a rate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Gt

from whid.blocks._block import STEADY, Block, Free, State, Tangents
from whid.signal import Floats, Ints, Panels, Signal, Splits, rule

Course = Callable[[Ints, Floats], Floats]  # of some intervals at places in them


@dataclass(frozen=True, kw_only=True)
class SlewLimit(Block):
    """A follower of a held signal that moves at most so much a second; it stays where it has arrived.

    w(t_n + τ) = w(t_n) + sign(v_n − w(t_n))·min(|v_n − w(t_n)|, rate·τ),  0 ≤ τ < dt

          w      ╱── v
          │    ╱
          │──╱
          └────────► t

    rate > 0 in input units a second. What comes in counts at its samples and is held between them, as an actuator holds what
    it was told; at the first sample the follower is there already. State: where it has arrived.

    >>> SlewLimit(rate=2.0)([0.0, 5.0, 5.0, 5.0, 0.0], dt=1.0)
    array([0., 0., 2., 4., 5.])
    """

    rate: Annotated[float, Free("input/s", 0.0), Gt(0)]

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Follow from sample to sample."""
        way, end = _followed(signal, self.rate, _begun(signal, state))
        return way.signal(signal, self.rate), end

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Follow the derivatives: what has arrived moves with v, what is on its way with its start and the rate."""
        plain, starts = state if isinstance(state, tuple) else (state, None)
        way, end = _followed(signal, self.rate, _begun(signal, plain))
        found, ends = [], []
        for k in range(len(seeds) + len(wrt)):
            dv = seeds[k].values if k < len(seeds) else np.zeros(len(signal.values))
            begun = starts[k] if starts is not None else (dv[0] if len(dv) else 0.0)
            out, last = way.moved(signal, dv, begun, 0.0 if k < len(seeds) else 1.0, self.rate)
            found.append(out)
            ends.append(last)
        return Tangents(way.signal(signal, self.rate), found, (end, ends))

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the level: it has arrived."""
        return level, level


class _Way(NamedTuple):
    """Where the follower is at every sample, which way it goes from there, and when it arrives (1: not within)."""

    start: Floats
    sign: Floats
    arrives: Floats  # share of the interval

    def signal(self, signal: Signal, rate: float) -> Signal:
        """Return the course as a signal, every interval in which it arrives split there."""
        if signal.sampled:
            return signal.with_values(self.start, "discrete")
        speed, v, dt = self.sign * rate, signal.values, signal.dt

        def ramp(index: Ints, tau: Floats) -> Floats:
            return np.asarray(self.start[index] + speed[index] * dt * tau)

        def rest(index: Ints, tau: Floats) -> Floats:
            return np.broadcast_to(v[index], tau.shape)

        return signal.with_values(self.start, lambda: self._panels(signal.order, ramp, rest))

    def moved(self, signal: Signal, dv: Floats, begun: float, by: float, rate: float) -> tuple[Signal, float]:
        """Return the derivative along dv, of the rate itself by `by`, and where it ends."""
        dt, n = signal.dt, len(dv)
        dw, here = np.empty(n), float(begun)
        late = (self.arrives >= 1.0).tolist()
        step, dvs = (self.sign * dt * by).tolist(), dv.tolist()
        for k in range(n):
            dw[k] = here
            here = here + step[k] if late[k] else dvs[k]
        if signal.sampled:
            return signal.with_values(dw, "discrete"), here

        def ramp(index: Ints, tau: Floats) -> Floats:
            return np.asarray(dw[index] + by * self.sign[index] * dt * tau)

        def rest(index: Ints, tau: Floats) -> Floats:
            return np.broadcast_to(dv[index], tau.shape)

        return signal.with_values(dw, lambda: self._panels(signal.order, ramp, rest)), here

    def _panels(self, order: int, ramp: Course, rest: Course) -> Panels:
        nodes, every = rule(order).nodes, np.arange(len(self.start))
        tau = np.broadcast_to(nodes[:, None], (order, len(every)))
        dense: Floats = np.where(self.arrives > 0, ramp(every, tau), rest(every, tau))
        k = np.flatnonzero((self.arrives > 0) & (self.arrives < 1))
        if not len(k):
            return Panels(dense)
        a = self.arrives[k]
        first, second = ramp(k, a * nodes[:, None]), rest(k, a + (1 - a) * nodes[:, None])
        interval, start = np.repeat(k, 2), np.stack([np.zeros(len(k)), a], axis=1).ravel()
        width = np.stack([a, 1 - a], axis=1).ravel()
        values = np.stack([first, second], axis=2).reshape(order, -1)
        return Panels(dense, Splits(interval, start, width, values))


def _begun(signal: Signal, state: State) -> float:
    if state is None or state == STEADY:
        return float(signal.values[0]) if len(signal.values) else 0.0
    return float(state)


def _followed(signal: Signal, rate: float, w: float) -> tuple[_Way, float]:
    most = rate * signal.dt
    start, gaps = np.empty(len(signal.values)), np.empty(len(signal.values))
    for n, v in enumerate(signal.values.tolist()):
        gap = v - w
        start[n], gaps[n] = w, gap
        w = v if abs(gap) <= most else (w + most if gap > 0 else w - most)
    return _Way(start, np.sign(gaps), np.minimum(np.abs(gaps) / most, 1.0)), w
