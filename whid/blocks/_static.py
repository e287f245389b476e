"""Static (memoryless) blocks: w(t) = f(v(t)), with the breakpoints of f met exactly between samples."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from whid.blocks._block import PERIODIC, Block, State, Tangents
from whid.blocks._split import Crossings, onto, sides, split, value_at
from whid.blocks._stack import Bundle, stacked
from whid.signal import NO_IMPULSES, Floats, Impulses, Ints, Panels, Signal, Sparse

Course = Callable[[], tuple[Panels, Crossings]]  # the input's panels, split at the breakpoints, made when needed


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

    def sensitivities(self, v: Floats, names: Sequence[str], out: Floats) -> None:
        """Write ∂f(v)/∂name into the rows of out (k, *v.shape); a leaf whose rows have work in common does it once."""
        for row, name in zip(out, names, strict=True):
            row[...] = self.sensitivity(v, name)

    def on_pieces(self, v: Floats) -> Floats:
        """Return `value` on panels (q, n) that each lie on one piece of f; a leaf may look the piece up once a panel."""
        return self.value(v)

    def derivative_on_pieces(self, v: Floats) -> Floats:
        """Return `derivative` on panels (q, n) that each lie on one piece of f."""
        return self.derivative(v)

    def few(self, v: Floats, names: Sequence[str]) -> tuple[Ints, Floats] | None:
        """Return what of `sensitivities` is not 0 on panels that each lie on one piece of f, None where that is most of it.

        v (q, n) → the places in `names` (r, n), −1 where there is none, and the values there (r, q, n).
        """
        return None

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
        return self._output(signal, lambda: self._split(signal, state)), None

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Return f(v), then f′(v)·dv for every seed and ∂f/∂θ for every name, jumps as impulses in time."""
        course = cache(lambda: self._split(signal, state))
        out = self._output(signal, course)
        if not seeds and not wrt:
            return Tangents(out, [], None)
        stack = stacked(seeds) if seeds else None
        values = self._rates(signal.values, None if stack is None else stack.values, wrt)
        if not callable(signal.between) and (stack is None or not callable(stack.between)):
            return Tangents(out, Bundle(signal.with_values(values)), None)

        def between(names: Sequence[str] = wrt) -> Panels:
            panels, crossings = course()
            s = panels.splits
            along = None if stack is None else onto(stack, s)
            dense = self._rates(panels.values, None if along is None else along.values, names)
            if len(s.interval):
                s = s._replace(values=self._rates(s.values, None if along is None else along.splits.values, names))
            own = self._impulses(crossings, along, wrt, signal.dt)
            return Panels(dense, s, own if along is None else _joined(own, self._passed(panels, along.impulses, len(wrt))))

        def sparse() -> Sparse:
            panels, _ = course()
            found = [self.few(v, wrt) for v in (panels.values, panels.splits.values) if v.size]
            (place, inner), *split_up = [each for each in found if each is not None]
            none = np.empty((len(place), 0), np.intp), np.empty((len(place), len(panels.values), 0))
            return Sparse(between(()), place, inner, *(split_up[0] if split_up else none))

        mostly_zeros = len(wrt) > 1 and self.few(signal.values[None, :1], wrt) is not None
        rates = Signal(
            values, signal.dt, signal.t0, between, signal.order, sparse if mostly_zeros else None, kept=signal.kept
        )
        return Tangents(out, Bundle(rates), None)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return f(level); a static block has no state."""
        return float(self.value(np.array([level]))[0]), None

    def _rates(self, v: Floats, along: Floats | None, wrt: Sequence[str]) -> Floats:
        """Return f′(v)·dv of every seed, then ∂f/∂θ of every name: (p + k, *v.shape)."""
        count = 0 if along is None else len(along)
        out = np.empty((count + len(wrt), *v.shape))
        if along is not None:
            np.multiply(along, self.derivative(v) if v.ndim == 1 else self.derivative_on_pieces(v), out=out[:count])
        if wrt:
            self.sensitivities(v, wrt, out[count:])
        return out

    def _split(self, signal: Signal, state: State) -> tuple[Panels, Crossings]:
        periodic = state == PERIODIC
        found: tuple[Panels, Crossings] = signal.once(lambda: self._course(signal, periodic), Static._course, self, signal)
        return found

    def _course(self, signal: Signal, periodic: bool) -> tuple[Panels, Crossings]:
        return split(signal, self.breakpoints(), periodic)

    def _jumps_at(self, which: Ints) -> Floats:
        return np.asarray(self.jumps()[which])

    def _rates_at(self, which: Ints, name: str) -> Floats:
        return np.asarray(self.break_rates(name)[which])

    def _output(self, signal: Signal, course: Course) -> Signal:
        if signal.kept is None:
            return self._applied(signal, course)
        found: Signal = signal.once(
            lambda: replace(self._applied(signal, course), kept=signal.kept), Static._output, self, signal
        )
        return found

    def _applied(self, signal: Signal, course: Course) -> Signal:
        values = self.value(signal.values)
        if not callable(signal.between):
            return signal.with_values(values)

        def between() -> Panels:
            panels, _ = course()
            s = panels.splits
            inner = s._replace(values=self.on_pieces(s.values)) if len(s.interval) else s
            return Panels(self.on_pieces(panels.values), inner)

        return signal.with_values(values, between)

    def _impulses(self, crossings: Crossings, along: Panels | None, wrt: Sequence[str], dt: float) -> Impulses:
        """J·(dv − db)/|v̇| at every crossing: w jumps by ±J there, and the crossing moves by −(dv − db)/v̇."""
        jump = self._jumps_at(crossings.which)
        keep = (jump != 0) & (crossings.speed > 0)
        if not keep.any():
            return NO_IMPULSES
        c = crossings.where(keep)
        moved = [] if along is None else [value_at(along, c.interval, c.at)]
        if wrt:
            moved.append(np.array([-self._rates_at(c.which, name) for name in wrt]))
        return Impulses(c.interval, c.at, np.concatenate(moved) * (jump[keep] / c.speed * dt))

    def _passed(self, panels: Panels, impulses: Impulses, own: int) -> Impulses:
        """An impulse moves a jump of v in time, so f's own jump there: its area times the secant slope of f."""
        if not len(impulses.interval):
            return NO_IMPULSES
        left, right = sides(panels, impulses.interval, impulses.at)
        rise = right - left
        smooth = np.abs(rise) <= 1e-9 * (np.abs(left) + np.abs(right))
        secant = (self.value(right) - self.value(left)) / np.where(smooth, 1.0, rise)
        area = impulses.area * np.where(smooth, self.derivative(right), secant)
        return impulses._replace(area=np.concatenate([area, np.zeros((own, area.shape[-1]))]))


def _joined(a: Impulses, b: Impulses) -> Impulses:
    given = [i for i in (a, b) if len(i.interval)]
    return Impulses(*(np.concatenate(column, axis=-1) for column in zip(*given, strict=True))) if given else NO_IMPULSES
