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
CLOSE, CLOSE_RATE = 1e-14, 1e-11  # of the largest value: the loop has settled


class Round(NamedTuple):
    """Where both blocks of a loop stand."""

    forward: Any = None
    back: Any = None


class Relaxed(NamedTuple):
    """y = forward(u + sign·back(y)), between samples as well."""

    forward: Block
    back: Block | None
    sign: Literal[-1, 1]

    def step(self, u: Signal, at: Round) -> tuple[Signal, Round]:
        """Return y over a window and where the blocks stand behind it; halves that do not settle are solved in turn.

        The map y → forward(u + sign·back(y)) of a loop with dynamics contracts on every window that is short enough
        [Lelarasmee, Ruehli and Sangiovanni-Vincentelli 1982]. Raises `WhidError("feedback-no-solution")`.
        """
        y, end = self.forward.step(u, at.forward)
        for _ in range(ROUNDS):
            z, back = (y, None) if self.back is None else self.back.step(y, at.back)
            again, end = self.forward.step(self._fed(u, z), at.forward)
            moved = _far(again, y, CLOSE)
            y = again
            if moved is None:
                break
            if not moved:
                return y, Round(end, back)
        if len(u.values) < 2:
            raise WhidError("feedback-no-solution", "the loop does not settle within one sample", f"t = {u.t0:g} s")
        half = len(u.values) // 2
        first, at = self.step(u[:half], at)
        second, at = self.step(u[half:], at)
        return joined(first, second), at

    def tangent(
        self, u: Signal, inputs: Sequence[Signal], wrt: Sequence[str], at: Round, along: Round
    ) -> tuple[Signal, Sequence[Signal], Round, Round]:
        """Return y, its derivatives (a column an input, the blocks' own numbers added to the last len(wrt)), the states."""
        if not inputs:
            y, at = self.step(u, at)
            return y, [], at, at
        y, found, at, along = self._rates(u, stacked(inputs), wrt, at, along)
        return y, Bundle(found), at, along

    def _rates(
        self, u: Signal, du: Signal, wrt: Sequence[str], at: Round, along: Round
    ) -> tuple[Signal, Signal, Round, Round]:
        y, _ = self.step(u, at)
        z, back = (y, None) if self.back is None else self.back.step(y, at.back)
        e = self._fed(u, z)
        _, plain = self.forward.step(e, at.forward)
        found, states = _added(self.forward, e, du, wrt, "forward.", along.forward)
        for _ in range(ROUNDS):
            dz, behind = (found, None) if self.back is None else _added(self.back, y, found, wrt, "back.", along.back)
            again, states = _added(self.forward, e, self._fed(du, dz), wrt, "forward.", along.forward)
            moved = _far(again, found, CLOSE_RATE)
            found = again
            if moved is None:
                break
            if not moved:
                return y, found, Round(plain, back), Round(states, behind)
        if len(u.values) < 2:
            raise WhidError("feedback-no-solution", "the loop's derivative does not settle", f"t = {u.t0:g} s")
        half = len(u.values) // 2
        y, left, at, along = self._rates(u[:half], du[:half], wrt, at, along)
        rest, right, at, along = self._rates(u[half:], du[half:], wrt, at, along)
        return joined(y, rest), joined(left, right), at, along

    def _fed(self, u: Signal, z: Signal) -> Signal:
        return total([u, z if self.sign > 0 else pointwise(np.negative, [z], _opposite)])


def _opposite(courses: Sequence[Any]) -> Any:
    hits = courses[0].impulses
    return hits._replace(area=-hits.area)


def _far(new: Signal, old: Signal, close: float) -> bool | None:
    """Tell whether a signal, or one of a stack, still moves; None where one runs away."""
    x, before = _course(new), _course(old)
    size, change = (np.abs(v).max(axis=(-2, -1), initial=0.0) for v in (x, x - before))
    if not np.all(np.isfinite(size)) or np.any(size > 1e9 * (1 + np.abs(before).max(axis=(-2, -1), initial=0.0))):
        return None
    return bool(np.any(change > close * size))


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
