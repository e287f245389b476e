"""Where a signal crosses the breakpoints of a static block, and its panels split there so that f is smooth on each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from whid.signal import NO_IMPULSES, NO_SPLITS, Floats, Impulses, Ints, Panels, Signal, Splits, at, picked, rule

Bools = NDArray[np.bool_]


class Crossings(NamedTuple):
    """Where the signal crosses a breakpoint."""

    interval: Ints  # (m,)
    at: Floats  # (m,) in [0, 1]; 1 where it crosses at the next sample
    which: Ints  # (m,) breakpoint
    speed: Floats  # (m,) |v̇|, signal units per interval

    def where(self, keep: Bools) -> Crossings:
        """Return some of the crossings."""
        return Crossings(self.interval[keep], self.at[keep], self.which[keep], self.speed[keep])


NO_CROSSINGS = Crossings(np.empty(0, np.intp), np.empty(0), np.empty(0, np.intp), np.empty(0))


def split(signal: Signal, breaks: Floats, periodic: bool = False) -> tuple[Panels, Crossings]:
    """Return the panels, split where the signal crosses a breakpoint, and the crossings.

    A jump of the signal itself over a breakpoint is no crossing: it is a border between panels already. Of a periodic signal
    the last interval is the one before the first.
    """
    panels = signal.panels
    if not len(breaks) or not len(signal.values):
        return panels, NO_CROSSINGS
    parts = _candidates(panels, breaks)
    owner, tau, which, slope = _crossings(parts, breaks, signal.samples if periodic else np.inf)
    if not len(owner) and len(panels.splits.interval) == 0:
        return panels, NO_CROSSINGS
    keep = (parts.width < 1) | (parts.start > 0)  # a near miss stays whole
    keep[owner] = True
    whole = np.flatnonzero(keep)
    panel, begin = np.concatenate([whole, owner]), np.concatenate([np.zeros(len(whole)), tau])
    order = np.lexsort((begin, panel))
    panel, begin = panel[order], begin[order]
    end = np.append(np.where(panel[1:] == panel[:-1], begin[1:], 1.0), 1.0)
    wide = end - begin > 1e-14
    panel, begin, end = panel[wide], begin[wide], end[wide]
    inner = at(picked(parts.values, panel), begin + (end - begin) * rule(len(parts.values)).nodes[:, None])
    start = parts.start[panel] + begin * parts.width[panel]
    splits = Splits(parts.interval[panel], start, (end - begin) * parts.width[panel], inner)
    when = parts.start[owner] + tau * parts.width[owner]
    index = parts.interval[owner]
    early = when < 1e-14  # at a sample: it belongs to the end of the interval before
    index = np.where(early & (index == 0) & periodic, signal.samples, index) - early
    crossings = Crossings(index, np.where(early, 1.0, when), which, slope / parts.width[owner])
    return Panels(panels.values, splits, panels.impulses), crossings.where(crossings.interval >= 0)


def onto(seed: Signal, s: Splits) -> Panels:
    """Return a seed's panels on the splits of the signal it belongs to (as fine as the seed's own, or finer)."""
    panels = seed.panels
    if not len(s.interval):
        return panels
    return panels._replace(splits=s._replace(values=refined(panels, s)))


def same(a: Splits, b: Splits) -> bool:
    """Tell whether two signals are split at the same places, by the very arrays they share."""
    return a.interval is b.interval and a.start is b.start


def refined(panels: Panels, s: Splits) -> Floats:
    """Return a signal's values at the nodes of some sub-panels, each of which lies in one panel of the signal."""
    if same(panels.splits, s):
        return panels.splits.values
    local = s.start + s.width * rule(panels.values.shape[-2]).nodes[:, None]
    return _values_at(panels, s.interval, local, s.start + s.width / 2)


def total(signals: Sequence[Signal]) -> Signal:
    """Return the sum of signals on one grid, on the union of their splits, impulses included."""

    def impulses(courses: Sequence[Panels]) -> Impulses:
        given = [course.impulses for course in courses if len(course.impulses.interval)]
        return Impulses(*(np.concatenate(column, axis=-1) for column in zip(*given, strict=True))) if given else NO_IMPULSES

    return pointwise(lambda *values: np.sum(values, axis=0), signals, impulses)


def pointwise(
    function: Callable[..., Floats],
    signals: Sequence[Signal],
    impulses: Callable[[Sequence[Panels]], Impulses] | None = None,
) -> Signal:
    """Return function(x₁(t), x₂(t), …) of signals on one grid, on the union of their splits."""
    values = function(*(signal.values for signal in signals))
    inner = [signal for signal in signals if callable(signal.between)]
    if not inner:
        return signals[0].with_values(values)

    def between() -> Panels:
        courses = [signal.panels for signal in signals]
        s = united([course.splits for course in courses])
        if len(s.interval):
            s = s._replace(values=function(*(refined(course, s) for course in courses)))
        dense = function(*(course.values for course in courses))
        return Panels(dense, s, NO_IMPULSES if impulses is None else impulses(courses))

    return inner[0].with_values(values, between)


def united(splits: Sequence[Splits]) -> Splits:
    """Return sub-panels as fine as all the given ones together; their values are still to come."""
    given = [s for s in splits if len(s.interval)]
    if all(same(s, given[0]) for s in given):
        return given[0] if given else NO_SPLITS
    index, start = np.concatenate([s.interval for s in given]), np.concatenate([s.start for s in given])
    order = np.lexsort((start, index))
    index, start = index[order], start[order]
    last = np.append(index[1:] != index[:-1], True)
    width = np.where(last, 1.0, np.append(start[1:], 1.0)) - start
    wide = width > 1e-14
    return Splits(index[wide], start[wide], width[wide], np.empty((0, 0)))


def value_at(panels: Panels, index: Ints, when: Floats) -> Floats:
    """Return the value of a signal inside some intervals; where it jumps the right one."""
    return _values_at(panels, index, when, when + 1e-9)


def sides(panels: Panels, index: Ints, when: Floats) -> tuple[Floats, Floats]:
    """Return the limits from the left and from the right; at the end of the last interval twice the left one."""
    left = _values_at(panels, index, when, when - 1e-9)
    wrap = (when >= 1.0) & (index + 1 < panels.values.shape[-1])
    right = np.where(when >= 1.0, left, _values_at(panels, index, when, when + 1e-9))
    if wrap.any():
        zero = np.zeros(int(wrap.sum()))
        right[wrap] = _values_at(panels, index[wrap] + 1, zero, zero + 1e-9)
    return left, right


def _values_at(panels: Panels, index: Ints, local: Floats, place: Floats) -> Floats:
    """Evaluate at `local` of each interval, on the sub-panel that `place` lies in where the interval is split."""
    values = at(picked(panels.values, index), local)
    own = panels.splits
    if not len(own.interval):
        return values
    panel = np.searchsorted(own.interval + own.start, index + place, side="right") - 1
    hit = (panel >= 0) & (own.interval[panel] == index)
    p = panel[hit]
    inside = np.clip((local[..., hit] - own.start[p]) / own.width[p], 0.0, 1.0)
    values[..., hit] = at(picked(own.values, p), inside)
    return values


def _candidates(panels: Panels, breaks: Floats) -> Splits:
    """Return the panels that may cross a breakpoint, and every sub-panel, in time order."""
    near = _near(panels.values, breaks)
    s = panels.splits
    near[s.interval] = False
    dense = np.flatnonzero(near)
    if not len(s.interval):
        return Splits(dense, np.zeros(len(dense)), np.ones(len(dense)), picked(panels.values, dense))
    index = np.concatenate([dense, s.interval])
    start = np.concatenate([np.zeros(len(dense)), s.start])
    order = np.lexsort((start, index))
    width = np.concatenate([np.ones(len(dense)), s.width])
    return Splits(
        index[order], start[order], width[order], picked(np.hstack([picked(panels.values, dense), s.values]), order)
    )


def _near(values: Floats, breaks: Floats) -> Bools:
    """Tell which panels may cross a breakpoint: the span of the nodes, widened by half of itself."""
    low, high = values.min(axis=0), values.max(axis=0)
    margin = 0.5 * (high - low)
    low, high = low - margin, high + margin
    if len(breaks) > 16:
        return np.asarray(high >= np.append(breaks, np.inf)[np.searchsorted(breaks, low)])
    hit = np.zeros(values.shape[1], bool)  # for a handful, a comparison a break is ten times faster
    for b in breaks:
        hit |= (low <= b) & (high >= b)
    return hit


class _Stretches(NamedTuple):
    """Parts of panels on which the course is monotone, and how many breakpoints lie below either end."""

    panel: Ints
    low: Floats  # where it begins, τ
    high: Floats
    before: Ints
    after: Ints


NO_STRETCHES = _Stretches(NO_SPLITS.interval, NO_SPLITS.start, NO_SPLITS.start, NO_SPLITS.interval, NO_SPLITS.interval)


def _crossings(parts: Splits, breaks: Floats, period: float) -> tuple[Ints, Floats, Ints, Floats]:
    """Return (panel, τ, breakpoint, |dv/dτ|) of every crossing; period: the intervals after which all comes again.

    A stretch on which a panel is monotone and whose ends lie on different sides of a breakpoint crosses it once. Most panels
    are one stretch: the mean of their slope outweighs its change.
    """
    q = len(parts.values)
    course = np.asarray(rule(q).to_legendre @ parts.values)
    slope = np.asarray(2 * legendre.legder(course, axis=0), np.float64)
    size = np.abs(parts.values).max(initial=0.0)
    ends = _continued(rule(q).ends @ parts.values, parts, size, period)
    straight = np.abs(slope[0]) > np.abs(slope[1:]).sum(axis=0)
    moving = np.abs(ends[1] - ends[0]) > 1e-13 * size  # a level that sits on a breakpoint only rounds
    whole = np.flatnonzero(straight & moving)
    before, after = np.searchsorted(breaks, picked(ends, whole), side="right")
    one = _Stretches(whole, np.zeros(len(whole)), np.ones(len(whole)), before, after)
    bent = _bent(np.flatnonzero(~straight), course, slope, ends, breaks, size)
    panel, low, high, before, after = (np.concatenate(pair) for pair in zip(one, bent, strict=True))
    times = np.abs(after - before)
    stretch = np.repeat(np.arange(len(panel)), times)
    nth = np.arange(len(stretch)) - np.repeat(np.cumsum(times) - times, times)
    which = np.minimum(before, after)[stretch] + nth
    owner, rising = panel[stretch], (after > before)[stretch]
    mine, bend = picked(course, owner), picked(slope, owner)
    tau = inverse(mine, bend, breaks[which], low[stretch], high[stretch], rising)
    return owner, tau, which, np.abs(_evaluate(bend, tau))


def _bent(mine: Ints, course: Floats, slope: Floats, ends: Floats, breaks: Floats, size: float) -> _Stretches:
    """Return the stretches of panels that may turn round: cut by a grid and where they turn: no graze is missed."""
    if not len(mine):
        return NO_STRETCHES
    q = len(course)
    grid = np.linspace(0.0, 1.0, 3 * q + 1)
    fine = np.asarray(legendre.legvander(2 * grid - 1, q - 1) @ course[:, mine])
    fine[0], fine[-1] = ends[:, mine]
    moving = np.ptp(fine, axis=0) > 1e-13 * size
    mine, fine = mine[moving], fine[:, moving]
    count = np.searchsorted(breaks, fine, side="right")
    cell, panel, turn = turning(slope[:, mine], grid)
    peak = np.searchsorted(breaks, _evaluate(course[:, mine[panel]], turn), side="right")
    straight = count[1:] != count[:-1]
    straight[cell, panel] = False
    c, p = np.nonzero(straight)
    return _Stretches(
        mine[np.concatenate([p, panel, panel])],
        np.concatenate([grid[c], grid[cell], turn]),
        np.concatenate([grid[c + 1], turn, grid[cell + 1]]),
        np.concatenate([count[c, p], count[cell, panel], peak]),
        np.concatenate([count[c + 1, p], peak, count[cell + 1, panel]]),
    )


def _continued(ends: Floats, parts: Splits, size: float, period: float) -> Floats:
    """Make a panel end on the very number the next one starts with, where only rounding parts them.

    A crossing at a sample is then found once, not twice or never.
    """
    begin, following = parts.interval + parts.start, np.roll(ends[0], -1)
    joined = np.abs(begin + parts.width - np.append(begin[1:], begin[:1] + period)) < 1e-9
    joined &= np.abs(ends[1] - following) <= 1e-12 * size
    ends[1, joined] = following[joined]
    return ends


def turning(slope: Floats, grid: Floats) -> tuple[Ints, Ints, Floats]:
    """Return (cell, panel, τ) where a panel's course turns round between two points of the grid."""
    rate = legendre.legvander(2 * grid - 1, len(slope) - 1) @ slope
    rising = rate > 0
    cell, panel = np.nonzero(rising[1:] != rising[:-1])
    mine = picked(slope, panel)
    bend = np.asarray(2 * legendre.legder(mine, axis=0), np.float64)
    return cell, panel, inverse(mine, bend, 0.0, grid[cell], grid[cell + 1], rising[cell + 1, panel])


def inverse(course: Floats, slope: Floats, target: Floats | float, low: Floats, high: Floats, rising: Bools) -> Floats:
    """Solve course(τ) = target in every bracket by Newton, bisecting wherever a step leaves it."""
    if not len(low):
        return low
    ends = _evaluate(course, np.stack([low, high]))
    with np.errstate(divide="ignore", invalid="ignore"):
        tau = low + (high - low) * (target - ends[0]) / (ends[1] - ends[0])  # where a straight line would
    tau = np.where((tau >= low) & (tau <= high), tau, (low + high) / 2)
    low, high, last = low.copy(), high.copy(), np.ones(len(tau))
    open_ = np.arange(len(tau))  # what has not settled yet: Newton takes five steps, only a few brackets more
    target = np.broadcast_to(target, tau.shape)
    both = np.zeros((len(course), 2, len(tau)))  # one evaluation for the value and its slope
    both[:, 0], both[: len(slope), 1] = course, slope
    for _ in range(60):
        if not len(open_):
            break
        here = tau[open_]
        value, rate = _evaluate(both if len(open_) == len(tau) else picked(both, open_), here)
        error = value - target[open_]
        above = (error >= 0) == rising[open_]
        low[open_], high[open_] = np.where(above, low[open_], here), np.where(above, here, high[open_])
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = here - error / rate
        step = np.abs(newton - here)  # rounding may put the last one just outside the bracket, or keep it from shrinking
        there = (step <= 1e-15) | ((step <= 1e-12) & (step >= last[open_]))
        last[open_] = step
        inside = (newton >= low[open_]) & (newton <= high[open_])
        tau[open_] = np.where(there, here, np.where(inside, newton, (low[open_] + high[open_]) / 2))
        open_ = open_[~there & (np.abs(tau[open_] - here) > 1e-15)]
    return np.asarray(tau)


def _evaluate(coefficients: Floats, tau: Floats) -> Floats:
    return np.asarray(legendre.legval(2 * tau - 1, coefficients, tensor=False))
