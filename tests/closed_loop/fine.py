"""The oversampled simulator behind the closed-loop test data: its own code, nothing of whid's.

Every signal lives on a grid FACTOR times finer than the record. In every fine step it is a straight line from `start` to
`end`: held inputs, steps at the samples and continuous signals are all of that kind, and a linear block passes them exactly.
What is left is the curvature within a fine step, O(h²).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter, tf2ss

Floats = NDArray[np.float64]
FACTOR = 24  # fine steps a sample


@dataclass(frozen=True)
class Fine:
    """A signal: from start[k] straight to end[k] in the k-th fine step of h seconds; `factor` of them are a sample."""

    start: Floats
    end: Floats
    h: float
    factor: int

    @cached_property
    def held(self) -> bool:
        """Return whether the signal is constant from sample to sample."""
        return self.start is self.end

    def of(self, start: Floats, end: Floats | None = None) -> Fine:
        """Return another signal on the same grid, continuous unless its ends are given."""
        return Fine(start, np.append(start[1:], start[-1]) if end is None else end, self.h, self.factor)

    def mapped(self, curve: Callable[[Floats], Floats]) -> Fine:
        """Return curve(signal)."""
        start = np.asarray(curve(self.start), float)
        if self.held:
            return self.of(start, start)
        joined = bool((self.end[:-1] == self.start[1:]).all())
        return self.of(start) if joined else self.of(start, np.asarray(curve(self.end), float))

    def __add__(self, other: Fine) -> Fine:
        start = self.start + other.start
        return self.of(start, start if self.held and other.held else self.end + other.end)

    def scaled(self, factor: float) -> Fine:
        """Return factor·signal."""
        return self.mapped(lambda v: factor * v)


Element = Callable[[Fine], Fine]  # what a tree is made of


def fine(u: Floats, dt: float, between: str = "zoh", factor: int = FACTOR) -> Fine:
    """Return an input: held between samples (zoh), or straight from sample to sample (foh)."""
    if between == "zoh":
        values = np.repeat(u, factor)
        return Fine(values, values, dt / factor, factor)
    values = np.interp(np.arange(len(u) * factor) / factor, np.arange(len(u)), u)
    return Fine(values, np.append(values[1:], u[-1]), dt / factor, factor)


@dataclass(frozen=True)
class Filter:
    """A strictly proper transfer function in s, from the steady state of the first value.

    x' = Ax + Bv, v = start + (end − start)·t/h: x⁺ = Φx + Γ₀·start + Γ₁·(end − start), from one matrix exponential.
    """

    num: tuple[float, ...]
    den: tuple[float, ...]

    def __call__(self, signal: Fine) -> Fine:
        if len(self.den) == 1:
            return signal.scaled(self.num[-1] / self.den[0])
        a, b, c, d = tf2ss(self.num, self.den)
        assert d[0, 0] == 0.0, "strictly proper blocks only"
        n, h = len(a), signal.h
        block = np.zeros((n + 2, n + 2))
        block[:n, :n], block[:n, n : n + 1] = a * h, b * h
        block[n, n + 1] = 1.0
        whole = expm(block)
        phi, held, ramp = whole[:n, :n], whole[:n, n], whole[:n, n + 1]
        driven = np.outer(held, signal.start)
        if not signal.held:
            driven += np.outer(ramp, signal.end - signal.start)
        x0 = np.linalg.solve(a, -b[:, 0] * signal.start[0])
        out = np.zeros(len(signal.start))
        lam, vectors = np.linalg.eig(phi)  # distinct poles: modes, one first-order filter each
        inner, seen = np.linalg.solve(vectors, driven.astype(complex)), (c[0] @ vectors)
        begin = np.linalg.solve(vectors, x0.astype(complex))
        for j in range(n):
            mode = np.empty(len(out), complex)
            mode[0] = begin[j]
            mode[1:], _ = lfilter([1.0], [1.0, -lam[j]], inner[j, :-1], zi=[lam[j] * begin[j]])
            out += np.real(seen[j] * mode)
        return signal.of(out)


@dataclass(frozen=True)
class Static:
    """A memoryless element; (where, how much) of the jumps of its curve.

    Where the signal crosses a jump within a fine step, the straight line there gets the area that it should have.
    """

    curve: Callable[[Floats], Floats]
    jumps: tuple[tuple[float, float], ...] = ()

    def __call__(self, signal: Fine) -> Fine:
        out = signal.mapped(self.curve)
        if not self.jumps or signal.held:
            return out
        end = out.end.copy()
        for b, height in self.jumps:
            k = np.flatnonzero((signal.start < b) != (signal.end < b))
            way = signal.end[k] - signal.start[k]
            before = (b - signal.start[k]) / way  # share of the step ahead of the crossing
            end[k] += 2 * height * np.sign(way) * (0.5 - before)
        return out.of(out.start, end)


def played(x: Floats, gap: float) -> Floats:
    """Return the play operator: the output rests until x has crossed the gap, then follows x ∓ gap/2.

    Before the first sample x came straight from 0, where the output stood in the middle.
    """
    half = gap / 2
    w = float(np.clip(0.0, x[0] - half, x[0] + half))
    out = np.empty(len(x))
    for k, value in enumerate(x.tolist()):
        if w < value - half:
            w = value - half
        elif w > value + half:
            w = value + half
        out[k] = w
    return out


@dataclass(frozen=True)
class Backlash:
    """The play operator on every corner of the signal's course."""

    gap: float

    def __call__(self, signal: Fine) -> Fine:
        if signal.held:
            values = np.repeat(played(signal.start[:: signal.factor], self.gap), signal.factor)
            return signal.of(values, values)
        corners = played(np.stack([signal.start, signal.end], axis=1).ravel(), self.gap)
        return signal.of(corners[::2], corners[1::2])


@dataclass(frozen=True)
class SlewLimit:
    """A follower of a held input that moves at most `rate` a second."""

    rate: float

    def __call__(self, signal: Fine) -> Fine:
        u, f, most = signal.start[:: signal.factor], signal.factor, self.rate * signal.h
        out, w, steps = np.empty((len(u), f)), float(u[0]), np.arange(f)
        for n, target in enumerate(u.tolist()):
            way = target - w
            out[n] = w if way == 0.0 else w + np.sign(way) * np.minimum(abs(way), most * steps)
            w += np.sign(way) * min(abs(way), most * f)
        return signal.of(out.ravel())


@dataclass(frozen=True)
class Series:
    """Elements one after another."""

    elements: tuple[Element, ...]

    def __call__(self, signal: Fine) -> Fine:
        for element in self.elements:
            signal = element(signal)
        return signal


@dataclass(frozen=True)
class Beside:
    """Two branches with the same input, summed."""

    one: Element
    other: Element

    def __call__(self, signal: Fine) -> Fine:
        return self.one(signal) + self.other(signal)


@dataclass(frozen=True)
class Loop:
    """y = forward(u − back(y)), by waveform relaxation: y goes round until it no longer moves (weak loops only)."""

    forward: Element
    back: Element

    def __call__(self, signal: Fine) -> Fine:
        y = self.forward(signal)
        for _ in range(80):
            again = self.forward(signal + self.back(y).scaled(-1.0))
            moved, size = float(np.abs(again.start - y.start).max()), float(np.abs(again.start).max())
            y = again
            if moved <= 1e-9 * size:
                return y
            if not size < 1e6 * float(np.abs(signal.start).max()):
                break
        raise ArithmeticError("the loop does not settle")
