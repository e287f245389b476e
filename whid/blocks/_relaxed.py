"""Loops in continuous time, solved by going round until nothing moves: waveform relaxation, window by window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.blocks._split import pointwise, total
from whid.blocks._stack import Bundle, stacked
from whid.errors import WhidError
from whid.signal import Floats, Signal, joined

ROUNDS = 60  # of a window before it is halved
PATIENCE, SLOW = 6, 0.05  # it is halved, too, where six rounds bring it less than twenty times nearer: sixty would not do
CLOSE, CLOSE_RATE = 1e-14, 1e-11  # of the largest value: the loop has settled


class Round(NamedTuple):
    """Where both blocks of a loop stand."""

    forward: Any = None
    back: Any = None


class Relaxed(NamedTuple):
    """y = forward(u + sign·back(y)), between samples as well.

    The map y → forward(u + sign·back(y)) of a loop with dynamics contracts on every window that is short enough
    [Lelarasmee, Ruehli and Sangiovanni-Vincentelli 1982]: faster than geometrically, so that a window on which it does so
    slowly is better halved, and the ones behind it begin as short.
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
        self, u: Signal, inputs: Sequence[Signal], wrt: Sequence[str], at: Round, along: Round
    ) -> tuple[Signal, Sequence[Signal], Round, Round]:
        """Return y, its derivatives (a column an input, the blocks' own numbers added to the last len(wrt)), the states."""
        if not inputs:
            y, at = self.step(u, at)
            return y, [], at, at
        outputs, rates, size, du = [], [], u.samples, stacked(inputs)
        while u.samples:
            part, along_part = (u[:size], du[:size]) if size < u.samples else (u, du)
            y, behind = self._settled(part, at)
            dy, behind_rates = (du, None) if behind is None else self._settled_rates(part, y, along_part, wrt, at, along)
            if behind is not None and behind_rates is not None:
                outputs.append(y)
                rates.append(dy)
                n = part.samples
                at, along, u, du, size = behind, behind_rates, u[n:], du[n:], 2 * n
            elif part.samples < 2:
                raise WhidError("feedback-no-solution", "the loop does not settle within one sample", f"t = {u.t0:g} s")
            else:
                size = part.samples // 2
        if len(outputs) == 1:
            return outputs[0], Bundle(rates[0]), at, along
        return joined(*outputs), Bundle(joined(*rates)), at, along

    def _settled(self, u: Signal, at: Round) -> tuple[Signal, Round | None]:
        """Return y over a window and the states behind it; None where going round does not settle it soon."""
        y, _ = self.forward.step(u, at.forward)
        watch = _Watch(CLOSE)
        for _ in range(ROUNDS):
            z, back = (y, None) if self.back is None else self.back.step(y, at.back)
            again, end = self.forward.step(self._fed(u, z), at.forward)
            moving = watch.moves(again, y)
            y = again
            if moving is None:
                break
            if not moving:
                return y, Round(end, back)
        return y, None

    def _settled_rates(
        self, u: Signal, y: Signal, du: Signal, wrt: Sequence[str], at: Round, along: Round
    ) -> tuple[Signal, Round | None]:
        """Return the derivatives of y over a window and the states behind it; None where they do not settle soon."""
        z = y if self.back is None else self.back.step(y, at.back)[0]
        e = self._fed(u, z)
        found, states = _added(self.forward, e, du, wrt, "forward.", along.forward)
        watch = _Watch(CLOSE_RATE)
        for _ in range(ROUNDS):
            dz, behind = (found, None) if self.back is None else _added(self.back, y, found, wrt, "back.", along.back)
            again, states = _added(self.forward, e, self._fed(du, dz), wrt, "forward.", along.forward)
            moving = watch.moves(again, found)
            found = again
            if moving is None:
                break
            if not moving:
                return found, Round(states, behind)
        return found, None

    def _fed(self, u: Signal, z: Signal) -> Signal:
        return total([u, z if self.sign > 0 else pointwise(np.negative, [z], _opposite)])


def _opposite(courses: Sequence[Any]) -> Any:
    hits = courses[0].impulses
    return hits._replace(area=-hits.area)


class _Watch:
    """Watches whether a signal, or a stack of them, settles from round to round."""

    def __init__(self, close: float) -> None:
        self.close = close
        self.moved: list[float] = []

    def moves(self, new: Signal, old: Signal) -> bool | None:
        """Tell whether it still moves by more than rounding; None where it runs away or will not settle soon."""
        x, before = _course(new), _course(old)
        size, change = (np.abs(v).max(axis=(-2, -1), initial=0.0) for v in (x, x - before))
        if not np.all(np.isfinite(size)) or np.any(size > 1e9 * (1 + np.abs(before).max(axis=(-2, -1), initial=0.0))):
            return None
        far = change > self.close * size
        if not np.any(far):
            return False
        with np.errstate(divide="ignore"):  # nothing yet, then something: it moves
            self.moved.append(float(np.max(change[far] / size[far])))
        slow = len(self.moved) > PATIENCE and self.moved[-1] > SLOW * self.moved[-1 - PATIENCE]
        return None if slow and new.samples > 1 else True


def _course(signal: Signal) -> Floats:
    """Return the samples, and what the signal does between them: (…, 1 or 1 + q, N)."""
    samples = signal.values[..., None, :]
    return np.concatenate([samples, signal.panels.values], axis=-2) if callable(signal.between) else samples


def _added(block: Block, signal: Signal, seeds: Signal, wrt: Sequence[str], prefix: str, state: Any) -> tuple[Signal, Any]:
    """Return a block's derivatives along a stack of seeds, the last len(wrt) with the block's own numbers added."""
    mine = [k for k, name in enumerate(wrt) if name.startswith(prefix)]
    _, along, state = block.tangent(signal, Bundle(seeds), [wrt[k][len(prefix) :] for k in mine], state)
    count = len(seeds.values)
    rows = [count - len(wrt) + k for k in mine]

    def summed(values: Floats) -> Floats:
        out = values[:count].copy()
        out[rows] += values[count:]
        return out

    def impulses(courses: Sequence[Any]) -> Any:
        hits = courses[0].impulses
        return hits._replace(area=summed(hits.area)) if len(hits.at) else hits

    return pointwise(summed, [stacked(along)], impulses), state
