"""Static (memoryless) blocks: w(t) = f(v(t)), with the breakpoints of f met exactly between samples."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from whid.blocks._block import Block, State, Tangents
from whid.signal import Floats, Impulses, Ints, Panels, Signal, Splits, at, rule


@dataclass(frozen=True, kw_only=True)
class Static(Block):
    """w = f(v). A leaf gives f, f′, the breakpoints, and the derivative with respect to each free scalar."""

    @abstractmethod
    def value(self, v: Floats) -> Floats:
        """Return f(v), any shape; at a breakpoint the value of the piece to its right."""

    @abstractmethod
    def derivative(self, v: Floats) -> Floats:
        """Return f′(v), any shape."""

    @abstractmethod
    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return ∂f(v)/∂name at fixed v (away from breakpoints), any shape."""

    def breakpoints(self) -> Floats:
        """Return the ascending v at which f or f′ jumps."""
        return np.empty(0)

    def break_rates(self, name: str) -> Floats:
        """Return the derivative of every breakpoint with respect to a free scalar."""
        return np.zeros(len(self.breakpoints()))

    def jumps(self) -> Floats:
        """Return f(b+) − f(b−) at every breakpoint."""
        return np.zeros(len(self.breakpoints()))

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Apply f to the samples and, where the signal lives between them, to its panels."""
        return self._output(signal), None

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Return f(v), then f′(v)·dv for every seed and ∂f/∂θ for every name, jumps as impulses in time."""
        along = [self._derivative(signal, seed, None) for seed in seeds]
        return Tangents(self._output(signal), along + [self._derivative(signal, None, name) for name in wrt], None)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return f(level); a static block has no state."""
        return float(self.value(np.array([level]))[0]), None

    def _output(self, signal: Signal) -> Signal:
        values = self.value(signal.values)
        if not callable(signal.between):
            return signal.with_values(values)

        def between() -> Panels:
            panels = split(signal, self.breakpoints()).panels
            s = panels.splits
            return Panels(self.value(panels.values), s._replace(values=self.value(s.values)) if len(s.index) else s)

        return signal.with_values(values, between)

    def _derivative(self, signal: Signal, seed: Signal | None, name: str | None) -> Signal:
        def rate(v: Floats, dv: Floats | None) -> Floats:
            return self.sensitivity(v, name) if name is not None else np.asarray(self.derivative(v) * dv)

        values = rate(signal.values, None if seed is None else seed.values)
        if not callable(signal.between) and (seed is None or not callable(seed.between)):
            return signal.with_values(values)

        def between() -> Panels:
            v = split(signal, self.breakpoints())
            panels, s = v.panels, v.panels.splits
            along = None if seed is None else onto(seed, s)
            dense = rate(panels.values, None if along is None else along.values)
            if not len(s.index):
                return Panels(dense)
            inner = s._replace(values=rate(s.values, None if along is None else along.splits.values))
            return Panels(dense, inner, self._impulses(s, along, name, signal.dt))

        return signal.with_values(values, between)

    def _impulses(self, s: Splits, along: Panels | None, name: str | None, dt: float) -> Impulses:
        """J·(dv − db)/|v̇| at every crossing: w jumps by ±J there, and the crossing moves by −(dv − db)/v̇."""
        breaks, jumps = self.breakpoints(), self.jumps()
        if not jumps.any():
            return Impulses(np.empty(0, np.intp), np.empty(0), np.empty(0))
        first = np.flatnonzero((s.start > 0) & np.append(False, s.index[1:] == s.index[:-1]))
        ends = rule(s.values.shape[0]).ends
        left = (ends @ s.values)[0, first]
        which = np.abs(left[:, None] - breaks).argmin(axis=1)
        scale = 1e-7 * (np.abs(breaks).max() + np.ptp(s.values))
        keep = (np.abs(left - breaks[which]) <= scale) & (jumps[which] != 0)
        first, which = first[keep], which[keep]
        speed = _end_slope(s.values[:, first]) / (s.width[first] * dt)
        moved = np.zeros(len(first)) if along is None else (ends @ along.splits.values)[0, first]
        if name is not None:
            moved = moved - self.break_rates(name)[which]
        return Impulses(s.index[first], s.start[first], jumps[which] * moved / np.abs(speed))


def _end_slope(values: Floats) -> Floats:
    """Return the derivative of each panel's interpolant at its left end, per unit of local coordinate."""
    q = values.shape[0]
    k = np.arange(q)
    left = 2 * (-1.0) ** (k - 1) * k * (k + 1) / 2  # P_k′(−1), chain factor 2
    return np.asarray(left @ (rule(q).to_legendre @ values))


def onto(seed: Signal, s: Splits) -> Panels:
    """Return a seed's panels on the splits of the signal it belongs to."""
    panels = seed.panels
    if not len(s.index):
        return panels
    own = panels.splits
    local = s.start + s.width * rule(s.values.shape[0]).nodes[:, None]
    values = at(panels.values[:, s.index], local)
    if len(own.index):
        key = own.index + own.start
        place = np.searchsorted(key, s.index + s.start + 1e-9 * s.width, side="right") - 1
        inside = (place >= 0) & (own.index[place] == s.index)
        p = place[inside]
        values[:, inside] = at(own.values[:, p], (local[:, inside] - own.start[p]) / own.width[p])
    return Panels(panels.values, s._replace(values=values), panels.impulses)


def split(signal: Signal, breaks: Floats) -> Signal:
    """Split every panel where the signal crosses a breakpoint, so that f is smooth on each."""
    panels = signal.panels
    if not len(breaks):
        return signal
    s = panels.splits
    whole = np.ones(panels.values.shape[1], bool)
    whole[s.index] = False
    dense = np.flatnonzero(_near(panels.values, breaks) & whole)
    index = np.concatenate([dense, s.index])
    start = np.concatenate([np.zeros(len(dense)), s.start])
    width = np.concatenate([np.ones(len(dense)), s.width])
    values = np.concatenate([panels.values[:, dense], s.values], axis=1) if len(s.index) else panels.values[:, dense]
    owner, local = _crossings(values, breaks)
    kept = np.ones(len(index), bool)
    kept[: len(dense)] = np.isin(np.arange(len(dense)), owner)  # a near miss stays whole
    base = np.flatnonzero(kept)
    if not len(base):
        return signal
    panel = np.concatenate([base, owner])
    begin = np.concatenate([np.zeros(len(base)), local])
    order = np.lexsort((begin, start[panel], index[panel]))
    panel, begin = panel[order], begin[order]
    end = np.append(np.where(panel[1:] == panel[:-1], begin[1:], 1.0), 1.0)
    keep = end - begin > 1e-14
    panel, begin, end = panel[keep], begin[keep], end[keep]
    inner = at(values[:, panel], begin + (end - begin) * rule(len(values)).nodes[:, None])
    splits = Splits(index[panel], start[panel] + begin * width[panel], (end - begin) * width[panel], inner)
    return signal.with_values(signal.values, lambda: Panels(panels.values, splits, panels.impulses))


def _near(values: Floats, breaks: Floats) -> np.ndarray:
    """Tell which panels may cross a breakpoint: the span of the nodes, widened by half of itself."""
    low, high = values.min(axis=0), values.max(axis=0)
    margin = 0.5 * (high - low)
    low, high = low - margin, high + margin
    hit = np.zeros(values.shape[1], bool)
    for b in breaks:
        hit |= (low < b) & (high > b)
    return hit


def _crossings(values: Floats, breaks: Floats) -> tuple[Ints, Floats]:
    """Return (panel, τ) of every crossing, by sign changes on a fine grid and safeguarded Newton steps."""
    grid = np.linspace(0.0, 1.0, 3 * values.shape[0] + 1)
    fine = legendre.legvander(2 * grid - 1, values.shape[0] - 1) @ (rule(values.shape[0]).to_legendre @ values)
    owners, places = [], []
    for b in breaks:
        side = fine >= b
        cell, panel = np.nonzero(side[1:] != side[:-1])
        low, high = grid[cell], grid[cell + 1]
        rising = side[cell + 1, panel]
        tau = low + (high - low) * (b - fine[cell, panel]) / (fine[cell + 1, panel] - fine[cell, panel])
        mine = values[:, panel]
        slope = _derivative_values(mine)
        for _ in range(8):
            error = at(mine, tau) - b
            above = (error >= 0) == rising
            low, high = np.where(above, low, tau), np.where(above, tau, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                newton = tau - error / at(slope, tau)
            tau = np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
        owners.append(panel)
        places.append(tau)
    return np.concatenate(owners).astype(np.intp), np.concatenate(places)


def _derivative_values(values: Floats) -> Floats:
    """Return the node values of each panel's derivative, per unit of local coordinate."""
    q = len(values)
    derivative = legendre.legder(rule(q).to_legendre @ values, axis=0) * 2
    return np.asarray(legendre.legvander(2 * rule(q).nodes - 1, max(q - 2, 0)) @ derivative)
