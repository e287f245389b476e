"""Loops in continuous time, solved by going round until nothing moves: waveform relaxation, window by window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.blocks._split import pointwise, total
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
            moved = _far([again], [y], CLOSE)
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
    ) -> tuple[Signal, list[Signal], Round, Round]:
        """Return y, its derivatives (a column an input, the blocks' own numbers added to the last len(wrt)), the states."""
        y, _ = self.step(u, at)
        z, back = (y, None) if self.back is None else self.back.step(y, at.back)
        e = self._fed(u, z)
        _, plain = self.forward.step(e, at.forward)
        found, states = _added(self.forward, e, inputs, wrt, "forward.", along.forward)
        for _ in range(ROUNDS):
            dz, behind = (found, None) if self.back is None else _added(self.back, y, found, wrt, "back.", along.back)
            again, states = _added(
                self.forward, e, [self._fed(d, r) for d, r in zip(inputs, dz, strict=True)], wrt, "forward.", along.forward
            )
            moved = _far(again, found, CLOSE_RATE)
            found = again
            if moved is None:
                break
            if not moved:
                return y, found, Round(plain, back), Round(states, behind)
        if len(u.values) < 2:
            raise WhidError("feedback-no-solution", "the loop's derivative does not settle", f"t = {u.t0:g} s")
        half = len(u.values) // 2
        y, left, at, along = self.tangent(u[:half], [d[:half] for d in inputs], wrt, at, along)
        rest, right, at, along = self.tangent(u[half:], [d[half:] for d in inputs], wrt, at, along)
        return joined(y, rest), [joined(a, b) for a, b in zip(left, right, strict=True)], at, along

    def _fed(self, u: Signal, z: Signal) -> Signal:
        return total([u, z if self.sign > 0 else pointwise(np.negative, [z], _opposite)])


def _opposite(courses: Sequence[Any]) -> Any:
    hits = courses[0].impulses
    return hits._replace(area=-hits.area)


def _far(new: Sequence[Signal], old: Sequence[Signal], close: float) -> bool | None:
    """Tell whether signals still move; None where they run away."""
    far = False
    for a, b in zip(new, old, strict=True):
        x, before = _course(a), _course(b)
        size, change = np.abs(x).max(initial=0.0), np.abs(x - before).max(initial=0.0)
        if not np.isfinite(size) or size > 1e9 * (1 + np.abs(before).max(initial=0.0)):
            return None
        far = far or bool(change > close * size)
    return far


def _course(signal: Signal) -> Floats:
    """Return the samples, and what the signal does between them."""
    return np.vstack([signal.values, signal.panels.values]) if callable(signal.between) else signal.values


def _added(
    block: Block, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], prefix: str, state: Any
) -> tuple[list[Signal], Any]:
    """Return a block's derivatives along the seeds, the last len(wrt) with the block's own numbers added."""
    mine = [k for k, name in enumerate(wrt) if name.startswith(prefix)]
    _, along, state = block.tangent(signal, seeds, [wrt[k][len(prefix) :] for k in mine], state)
    columns, first = list(along[: len(seeds)]), len(seeds) - len(wrt)
    for k, own in zip(mine, along[len(seeds) :], strict=True):
        columns[first + k] = total([columns[first + k], own])
    return columns, state
