"""Loops in continuous time, solved by going round until nothing moves: waveform relaxation, window by window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.blocks._split import pointwise, total
from whid.blocks._stack import Bundle, stacked
from whid.errors import WhidError
from whid.signal import Floats, Impulses, Panels, Signal, held, joined

ROUNDS = 60  # of a window before it is halved
PATIENCE, SLOW = 6, 0.05  # it is halved, too, where six rounds bring it less than twenty times nearer: sixty would not do
CELLS = 1 << 17  # numbers in a window of a stack of derivatives, at most: going round in the cache costs a tenth
NEARER = 1e-2  # of what a round moved: as near as the rounds to come are foreseen on samples
CLOSE, CLOSE_RATE = 1e-14, 1e-11  # of the largest value: the loop has settled


class Round(NamedTuple):
    """Where both blocks of a loop stand."""

    forward: Any = None
    back: Any = None


class Rates(NamedTuple):
    """Where both blocks stand with the derivatives that come round, and with those that they make of their own numbers."""

    along: Round
    own: Round

    @classmethod
    def of(cls, state: Any) -> Rates:
        """Return the start of a loop: the same state for all."""
        return cls(Round(state, state), Round(state, state))


class Relaxed(NamedTuple):
    """y = forward(u + sign·back(y)), between samples as well.

    The map y → forward(u + sign·back(y)) of a loop with dynamics contracts on every window that is short enough
    [Lelarasmee, Ruehli and Sangiovanni-Vincentelli 1982]: faster than geometrically, so that a window on which it does so
    slowly is better halved, and the ones behind it begin as short. Between samples a round is dear, and every round leaves
    the switching points of the one before in the signal; so what the rounds to come will add is foreseen on samples.
    """

    forward: Block
    back: Block | None
    sign: Literal[-1, 1]

    def step(self, u: Signal, at: Round) -> tuple[Signal, Round]:
        """Return y and where the blocks stand behind it. Raises `WhidError("feedback-no-solution")`."""
        found, size = [], u.samples
        while u.samples:
            part = u[:size] if size < u.samples else u
            y, behind = self._settled(part, at)
            if behind is not None:
                found.append(y)
                at, u, size = behind, u[part.samples :], 2 * part.samples
            elif part.samples < 2:
                raise WhidError("feedback-no-solution", "the loop does not settle within one sample", f"t = {u.t0:g} s")
            else:
                size = part.samples // 2
        return found[0] if len(found) == 1 else joined(*found), at

    def tangent(
        self, u: Signal, inputs: Sequence[Signal], wrt: Sequence[str], at: Round, rates: Rates
    ) -> tuple[Signal, Sequence[Signal], Round, Rates]:
        """Return y, its derivatives (a column an input, the blocks' own numbers added to the last len(wrt)), the states."""
        if not inputs:
            y, at = self.step(u, at)
            return y, [], at, rates
        outputs, found, du = [], [], stacked(inputs)
        size = most = max(CELLS // (len(inputs) * (1 if u.sampled else u.order)), 2)
        while u.samples:
            part, along = (u[:size], du[:size]) if size < u.samples else (u, du)
            y, behind = self._settled(part, at)
            dy, behind_rates = (du, None) if behind is None else self._settled_rates(part, y, along, wrt, at, rates)
            if behind is not None and behind_rates is not None:
                outputs.append(y)
                found.append(dy)
                n = part.samples
                at, rates, u, du, size = behind, behind_rates, u[n:], du[n:], min(2 * n, most)
            elif part.samples < 2:
                raise WhidError("feedback-no-solution", "the loop does not settle within one sample", f"t = {u.t0:g} s")
            else:
                size = part.samples // 2
        if len(outputs) == 1:
            return outputs[0], Bundle(found[0]), at, rates
        return joined(*outputs), Bundle(joined(*found)), at, rates

    def _settled(self, u: Signal, at: Round) -> tuple[Signal, Round | None]:
        """Return y over a window and the states behind it; None where going round does not settle it soon."""
        y, _ = self.forward.step(u, at.forward)
        watch, near = _Watch(CLOSE), None if u.sampled else self._near(u, at)
        y = y if near is None else _shifted(y, near, None)
        for _ in range(ROUNDS):
            z, back = (y, None) if self.back is None else self.back.step(y, at.back)
            again, end = self.forward.step(self._fed(u, z), at.forward)
            moving = watch.moves(again, y)
            if moving is None:
                break
            if not moving:
                return again, Round(end, back)
            y = again if near is None or not watch.nearing else _shifted(again, near, y)
        return y, None

    def _near(self, u: Signal, at: Round) -> Callable[[Floats | None], Floats]:
        """Return the map y → forward(u + sign·back(y)) on samples alone, None for nothing that comes back."""
        samples = u.with_values(u.values, "discrete")

        def around(y: Floats | None) -> Floats:
            if y is None:
                return self.forward.step(samples, at.forward)[0].values
            z = samples.with_values(y)
            z = z if self.back is None else self.back.step(z, at.back)[0]
            return self.forward.step(self._fed(samples, z), at.forward)[0].values

        return around

    def _settled_rates(
        self, u: Signal, y: Signal, du: Signal, wrt: Sequence[str], at: Round, rates: Rates
    ) -> tuple[Signal, Rates | None]:
        """Return the derivatives of y over a window and the states behind it; None where they do not settle soon.

        What the blocks' own numbers do at first hand is the same in every round: only what comes round is made again.
        """
        z = y if self.back is None else self.back.step(y, at.back)[0]
        e, columns = self._fed(u, z), len(du.values)
        ahead = _Own.of(self.forward, e, wrt, "forward.", columns, rates.own.forward)
        behind = None if self.back is None else _Own.of(self.back, y, wrt, "back.", columns, rates.own.back)
        found, forward = ahead.along(self.forward, e, du, rates.along.forward)
        watch = _Watch(CLOSE_RATE)
        for _ in range(ROUNDS):
            dz, back = found, None
            if self.back is not None and behind is not None:
                dz, back = behind.along(self.back, y, found, rates.along.back)
            again, forward = ahead.along(self.forward, e, self._fed(du, dz), rates.along.forward)
            moving = watch.moves(again, found)
            found = again
            if moving is None:
                break
            if not moving:
                return found, Rates(Round(forward, back), Round(ahead.state, behind and behind.state))
        return found, None

    def _fed(self, u: Signal, z: Signal) -> Signal:
        return total([u, z if self.sign > 0 else pointwise(np.negative, [z], _opposite)])


def _shifted(found: Signal, near: Callable[[Floats | None], Floats], of: Signal | None) -> Signal:
    """Return what a round made of a signal, moved by what the rounds to come will add to it on samples: on w = near(w) + d,
    d = found − near(of) the defect of that map. Between samples the move runs straight; a few rounds less then find it all.
    """
    before = None if of is None else of.values
    with np.errstate(all="ignore"):
        defect = found.values - near(before)
        enough = NEARER * float(np.abs(found.values - (0.0 if before is None else before)).max(initial=0.0))
        w = found.values
        for _ in range(ROUNDS):
            again = near(w) + defect
            moved = float(np.abs(again - w).max(initial=0.0))
            w = again
            if not moved > enough:
                break
    if not moved <= enough:
        return found
    return total([found, held(w - found.values, found.dt, "foh", found.t0, found.order)])


def _opposite(courses: Sequence[Any]) -> Any:
    hits = courses[0].impulses
    return hits._replace(area=-hits.area)


class _Watch:
    """Watches whether a signal, or a stack of them, settles from round to round."""

    def __init__(self, close: float) -> None:
        self.close = close
        self.moved: list[float] = []

    @property
    def nearing(self) -> bool:
        """Tell whether the last round moved it less than the one before."""
        return len(self.moved) < 2 or self.moved[-1] < self.moved[-2]

    def moves(self, new: Signal, old: Signal) -> bool | None:
        """Tell whether it still moves by more than rounding; None where it runs away or will not settle soon."""
        pairs = [(new.values, old.values)]
        if callable(new.between):
            pairs.append((new.panels.values, old.panels.values))
        size, before, change = (
            _largest(each) for each in ([x for x, _ in pairs], [x for _, x in pairs], [x - y for x, y in pairs])
        )
        if not np.all(np.isfinite(size)) or np.any(size > 1e9 * (1 + before)):
            return None
        far = change > self.close * size
        if not np.any(far):
            return False
        with np.errstate(divide="ignore"):  # nothing yet, then something: it moves
            self.moved.append(float(np.max(change[far] / size[far])))
        if len(self.moved) > 1 and self.moved[-1] ** 2 <= self.close * self.moved[-2]:
            return False  # the next round would move it by no more than rounding
        slow = len(self.moved) > PATIENCE and self.moved[-1] > SLOW * self.moved[-1 - PATIENCE]
        return None if slow and new.samples > 1 else True


def _largest(arrays: Sequence[Floats]) -> Floats:
    """Return the largest size in arrays (…, N) and (…, q, N), one number a column of a stack."""
    rows = [x.reshape(*x.shape[: arrays[0].ndim - 1], -1) for x in arrays]
    found = [np.maximum(x.max(axis=-1, initial=0.0), -x.min(axis=-1, initial=0.0)) for x in rows]
    return np.asarray(np.max(found, axis=0))


class _Own(NamedTuple):
    """What a block makes of its own numbers, a row a column of the loop's stack, and where it stands then."""

    made: Signal | None
    state: Any

    @classmethod
    def of(cls, block: Block, signal: Signal, wrt: Sequence[str], prefix: str, columns: int, state: Any) -> _Own:
        """Return the derivatives by the names that begin like this; all names belong to the last of so many columns."""
        mine = [k for k, name in enumerate(wrt) if name.startswith(prefix)]
        if not mine:
            return cls(None, state)
        _, found, state = block.tangent(signal, [], [wrt[k][len(prefix) :] for k in mine], state)
        rows = [columns - len(wrt) + k for k in mine]

        def spread(values: Floats) -> Floats:
            out = np.zeros((columns, *values.shape[1:]))
            out[rows] = values
            return out

        def impulses(courses: Sequence[Panels]) -> Impulses:
            hits = courses[0].impulses
            return hits._replace(area=spread(hits.area)) if len(hits.at) else hits

        return cls(pointwise(spread, [stacked(found)], impulses), state)

    def along(self, block: Block, signal: Signal, seeds: Signal, state: Any) -> tuple[Signal, Any]:
        """Return the block's derivatives along a stack of seeds with its own added, and where it stands then."""
        _, along, state = block.tangent(signal, Bundle(seeds), [], state)
        return (stacked(along) if self.made is None else total([stacked(along), self.made])), state
