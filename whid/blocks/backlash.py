"""Backlash between two polynomial borders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import MinLen

from whid.blocks._block import Block, Free, State, Tangents
from whid.blocks._contacts import FALLING, RISING, border, follow, touching
from whid.blocks._parts import cut_at, every, placed, turned
from whid.blocks._split import inverse, onto, sides, split
from whid.blocks._stack import Bundle, stacked
from whid.errors import WhidError
from whid.signal import NO_IMPULSES, Floats, Impulses, Ints, Signal, rule

JOINED = 1e-7  # of the span of a panel: what interpolation at its nodes may be off at its ends

Coefficients = Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(1)]


class _Held(NamedTuple):
    """What a chunk leaves: input, output (an array: a number that a free initial state may change), heading."""

    v: float
    w: Floats
    heading: float  # the sign of the input's last move, 0 before any
    rates: Floats = np.empty(0)  # of w, one a tangent


@dataclass(frozen=True, kw_only=True)
class Backlash(Block):
    """An output that follows one border while the input rises, another while it falls, and holds on the way between.

    A monotone run of v holds w until the first v on it, its start included, with border(v) = w (to rounding) or where
    border − w has changed sign, then w = border(v) to the run's end; without contact w is held into the next run.

          w     ╱──◄─╱
          │    ╱    ╱     rising:  w = r₀ + r₁v + … while v rises
    ──────┼───╱────╱─► v  falling: w = f₀ + f₁v + … while v falls
          │  ╱─►──╱

    gap: the classical play, v − gap/2 and v + gap/2, input units; a slope belongs to a linear block beside it.
    rising, falling: ascending coefficients, output/inputᵏ; they may cross and need not be invertible; equal ones are a
    static curve. Exactly one of the two forms. Between samples the turning points and contacts are met where they are;
    on the sampled path the samples are all there is. It starts, and is steady, as a move straight from v = 0 leaves it,
    where it stood midway between the borders. Raises `WhidError("block-parameters")`. Source [Giri], section 2.

    >>> Backlash(gap=0.6)([1.0, 0.0, -1.0], dt=1.0)
    array([ 0.7,  0.3, -0.7])
    """

    gap: Annotated[float, Free("input", lower=0.0)] | None = None
    rising: Coefficients | None = None
    falling: Coefficients | None = None

    def __post_init__(self) -> None:
        if (self.rising is None) != (self.falling is None) or (self.gap is None) == (self.rising is None):
            raise WhidError("block-parameters", "backlash needs either gap, or both rising and falling")
        if self.gap is not None and self.gap < 0:
            raise WhidError("block-parameters", f"backlash needs gap >= 0, not {self.gap:g}")

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Follow the samples and, where the signal lives between them, its turning points and contacts."""
        if not signal.samples:
            return signal, state
        course = _Course(self.table, signal, self._started(state), callable(signal.between))
        return course.output(), course.last()

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Return border′·dv + ∂border where w follows; where it is held, that of the point where the input turned."""
        if not signal.samples or not (seeds or wrt):
            out, state = self.step(signal, state)
            return Tangents(out, [signal] * (len(seeds) + len(wrt)), state)
        stack = stacked(seeds) if seeds else None
        changes = np.array([self._change(name) for name in wrt]).reshape(len(wrt), *self.table.shape)
        start = self._started(state)
        if not isinstance(state, _Held):
            start = start._replace(rates=np.concatenate([np.zeros(len(seeds)), changes[:, :, 0].mean(axis=1)]))
        elif not len(start.rates):
            start = start._replace(rates=np.zeros(len(seeds) + len(wrt)))
        inner = callable(signal.between) or (stack is not None and callable(stack.between))
        course = _Course(self.table, signal, start, inner)
        along, rates = course.derivatives(stack, changes)
        return Tangents(course.output(), Bundle(along), course.last(rates))

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return what a move straight from 0 to the level leaves: where the past decides, it is this one."""
        out, state = self.step(Signal(np.array([level]), dt))
        return float(out.values[0]), state

    @cached_property
    def table(self) -> Floats:
        """Return the borders' ascending coefficients, (2, n + 1): the falling one, the rising one."""
        if self.gap is not None:
            return np.array([[self.gap / 2, 1.0], [-self.gap / 2, 1.0]])
        return _table(self.falling or (), self.rising or ())

    def _change(self, name: str) -> Floats:
        """Return the table's derivative with respect to a free number."""
        if name == "gap":
            return np.array([[0.5, 0.0], [-0.5, 0.0]])
        head, _, power = name.partition(".")
        rates = np.zeros_like(self.table)
        rates[RISING if head == "rising" else FALLING, int(power)] = 1.0
        return rates

    def _started(self, state: State) -> _Held:
        return state if isinstance(state, _Held) else _Held(0.0, np.array([self.table[:, 0].mean()]), 0.0)


def _table(falling: tuple[float, ...], rising: tuple[float, ...]) -> Floats:
    table = np.zeros((2, max(len(falling), len(rising))))
    table[FALLING, : len(falling)], table[RISING, : len(rising)] = falling, rising
    return table


def _turns(slopes: Floats) -> Floats:
    """Return the v at which a border turns: between them, and on a run, a border is monotone."""
    trimmed = [np.polynomial.polynomial.polytrim(row) for row in slopes]
    roots = np.concatenate([np.polynomial.polynomial.polyroots(row) for row in trimmed])
    return np.unique(np.real(roots[np.abs(np.imag(roots)) <= 1e-9 * np.abs(roots)]))


class _Course:
    """One chunk: its knots (samples, and with `inner` every end of a panel on which v and the borders are monotone)."""

    def __init__(self, table: Floats, signal: Signal, start: _Held, inner: bool) -> None:
        self.table, self.signal, self.start, self.inner = table, signal, start, inner
        self.slopes = np.asarray(np.polynomial.polynomial.polyder(table, axis=1), float)
        knots = signal.values
        if inner:
            self.whole = turned(split(signal, _turns(self.slopes))[0])
            self.samples = np.flatnonzero(np.append(True, np.diff(self.whole.interval) > 0))  # panels that begin at one
            knots = _joined(_ends(self.whole.values, self.samples, signal.values), np.ptp(self.whole.values, axis=0))
        self.v = np.append(start.v, knots)
        self.path = follow(self.v, float(start.w[0]), start.heading, table)
        if inner:
            self._meet()

    def _meet(self) -> None:
        """Cut the panels where w meets a border inside, and note which of them follow, and what the others hold."""
        begin, end, w, side = self.v[1::2], self.v[2::2], self.path.w[0::2], self.path.side[1::2]
        on = self.path.source[1::2] == np.arange(1, len(self.path.w), 2)
        inside = np.flatnonzero(on & ~touching(self.table, side, begin, w) & (begin != end))
        meeting = np.zeros(len(on))
        meeting[inside] = self._contacts(inside, begin[inside], end[inside], w[inside], side[inside])
        cut = cut_at(self.whole, inside, meeting[inside])
        self.parts, self.panel_side = cut.parts, side[cut.owner]
        self.follows = on[cut.owner] & (cut.begin >= meeting[cut.owner])
        self.holds = np.where(on, self.path.source[0::2], self.path.source[1::2])[cut.owner]
        self.course = placed(cut.parts)

    def _contacts(self, panel: Ints, begin: Floats, end: Floats, w: Floats, side: Ints) -> Floats:
        """Return where on each panel, in [0, 1], the border comes to w: first the v, then the moment."""
        v = _solved(self.table, self.slopes, side, w, begin, end)
        course = rule(self.signal.order).to_legendre @ self.whole.values[:, panel]
        slope = np.asarray(2 * np.polynomial.legendre.legder(course, axis=0), float)
        return inverse(course, slope, v, np.zeros(len(v)), np.ones(len(v)), end > begin)

    def output(self) -> Signal:
        """Return w."""
        if not self.inner:
            return self.signal.with_values(self.path.w)
        values = border(self.table, self.panel_side, self.parts.values)
        held = np.append(self.path.w, self.start.w)[self.holds]
        panels = placed(self.parts._replace(values=np.where(self.follows, values, held)), self.course)
        return self.signal.with_values(self.path.w[2 * self.samples], lambda: panels)

    def derivatives(self, seeds: Signal | None, changes: Floats) -> tuple[Signal, Floats]:
        """Return dw along the seeds, then for changes (k, 2, n + 1) of the borders, and the last value of each."""
        at_knots = self._rates(self.path.side, self.v[1:], self._seeds_at_knots(seeds), changes)
        held = np.column_stack([at_knots, self.start.rates])  # the last column: what was before the chunk
        values = held[:, self.path.source]
        if not self.inner:
            return self.signal.with_values(values), values[:, -1].copy()
        along = None if seeds is None else onto(seeds, self.course.splits)
        dv = None if along is None else every(along._replace(impulses=NO_IMPULSES)).values
        rates = self._rates(self.panel_side, self.parts.values, dv, changes)
        rates = np.where(self.follows, rates, held[:, None, self.holds])
        panels = placed(self.parts._replace(values=rates), self.course)
        if along is not None and len(along.impulses.interval):
            panels = panels._replace(impulses=self._passed(along.impulses, len(changes)))
        return self.signal.with_values(values[:, 2 * self.samples], lambda: panels), values[:, -1].copy()

    def _seeds_at_knots(self, seeds: Signal | None) -> Floats | None:
        if seeds is None or not self.inner:
            return None if seeds is None else seeds.values
        values = every(onto(seeds, placed(self.whole).splits)).values
        return _ends(values, self.samples, seeds.values)

    def _rates(self, side: Ints, v: Floats, dv: Floats | None, changes: Floats) -> Floats:
        own = [border(change, side, v) for change in changes]
        rows = np.array(own).reshape(len(own), *v.shape)
        return rows if dv is None else np.concatenate([border(self.slopes, side, v) * dv, rows])

    def _passed(self, impulses: Impulses, own: int) -> Impulses:
        """An impulse moves a jump of v in time, so w's own jump there: its area times the ratio of the two."""
        (v0, v1), (w0, w1) = (sides(p, impulses.interval, impulses.at) for p in (self.course, self.output().panels))
        rise = v1 - v0
        ratio = np.where(rise != 0, (w1 - w0) / np.where(rise != 0, rise, 1.0), 0.0)
        area = impulses.area * ratio
        return impulses._replace(area=np.concatenate([area, np.zeros((own, area.shape[-1]))]))

    def last(self, rates: Floats | None = None) -> _Held:
        """Return the state after the chunk."""
        moves = np.sign(np.diff(self.v))
        moves = moves[moves != 0]
        heading = float(moves[-1]) if len(moves) else self.start.heading
        return _Held(float(self.v[-1]), self.path.w[-1:].copy(), heading, np.empty(0) if rates is None else rates)


def _ends(values: Floats, samples: Ints, at_samples: Floats) -> Floats:
    """Return (…, 2m): a signal at both ends of every panel, in time order; where one begins at a sample, the sample."""
    ends = rule(values.shape[-2]).ends @ values
    ends[..., 0, samples] = at_samples
    return np.asarray(np.swapaxes(ends, -1, -2).reshape(*ends.shape[:-2], -1))


def _joined(knots: Floats, span: Floats) -> Floats:
    """Let a panel end on the very number that the next begins with where a course through nodes does not tell them apart.

    There is no turning there: it would be one of JOINED of how far v goes on the panel, and w would meet its border again at
    once, in every interval of a decay.
    """
    end, following = knots[1:-1:2], knots[2::2]
    close = 1e-12 * np.abs(following) + JOINED * span[:-1]
    knots[1:-1:2] = np.where(np.abs(end - following) <= close, following, end)
    return knots


def _solved(table: Floats, slopes: Floats, side: Ints, w: Floats, low: Floats, high: Floats) -> Floats:
    """Solve border(v) = w on [low, high], where it is monotone: Newton, bisecting wherever a step leaves the bracket."""
    rising = border(table, side, high) > border(table, side, low)
    low, high = low.copy(), high.copy()
    v = (low + high) / 2
    for _ in range(60):
        error = border(table, side, v) - w
        above = (error >= 0) == rising
        low, high = np.where(above, low, v), np.where(above, v, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = v - error / border(slopes, side, v)
        inside = (newton - low) * (newton - high) <= 0
        following = np.where(inside, newton, (low + high) / 2)
        settled = np.all(np.abs(following - v) <= 1e-15 * (1 + np.abs(v)))
        v = following
        if settled:
            break
    return v
