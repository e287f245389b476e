"""Feedback: a block whose output comes back to its input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from whid.blocks._block import STEADY, Block, State, Tangents
from whid.blocks._loop import StaticLoop, error, memoryless, root, static_tangent
from whid.blocks._relaxed import Rates, Relaxed, Round
from whid.blocks._split import pointwise, total
from whid.signal import Floats, Signal, joined


@dataclass(frozen=True, kw_only=True)
class Feedback(Block):
    """A loop: y = forward(e), e = u + sign·z, z = back(y).

    u ──►(+)──e──►[forward]──┬──► y
          ▲±                 │
          └────z───[back]◄───┘

    solve: delay       e_n = u_n + sign·z_{n−1}: what comes back is one sample late (a digital controller)
           algebraic   e_n = u_n + sign·z_n: solved at every sample
           continuous  e(t) = u(t) + sign·z(t): nothing is held, the loop of a machine (`_relaxed.py`)

    Between samples what comes back is held (unless continuous) and everything else is exact; a loop of static blocks is
    solved between samples as well, its kinks met where they are. Without `back` the output itself comes back.
    Cost: a loop with dynamics goes sample by sample, some 0.3 ms a sample and block, algebraic four times that; a loop of
    static blocks is vectorised, and so is a continuous one: ten times the blocks' own cost where little comes back.
    Raises `WhidError("feedback-no-solution")`, and `"block-no-steady-state"` from its blocks.

    >>> from whid.blocks.polynomial import Polynomial
    >>> gain = Polynomial(coefficients=(0.0, 9.0))
    >>> Feedback(forward=gain, solve="algebraic")([1.0, 2.0], dt=1.0).round(6)
    array([0.9, 1.8])
    """

    forward: Block
    back: Block | None = None
    sign: Literal[-1, 1] = -1
    solve: Literal["delay", "algebraic", "continuous"] = "delay"

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Go round the loop sample by sample, or solve it everywhere at once when it has no memory."""
        if not len(signal.values):
            return signal, state
        if self._instant:
            return self.forward.step(error(self._static, signal))[0], None
        if self.relaxes:
            found: tuple[Signal, State] = signal.once(
                lambda: self._relaxed.step(signal, self._standing(signal, state)), Feedback.step, self, signal, state
            )
            return found
        passed = []
        loop = state if isinstance(state, _Loop) else self._started(signal, state)
        for n in range(len(signal.values)):
            u = signal[n : n + 1]
            z = loop.z if self.solve == "delay" else self._solved(u, loop)
            y, forward = self.forward.step(_plus(u, self.sign * z), loop.forward)
            w, back = (y, None) if self.back is None else self.back.step(y, loop.back)
            loop = _Loop(forward, back, w.values[:1])
            passed.append(y)
        return joined(*passed), loop

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Return the derivatives of the closed loop: every number acts once, and again each time it comes round."""
        if not len(signal.values):
            return Tangents(signal, [signal] * (len(seeds) + len(wrt)), state)
        if self._instant:
            return Tangents(*static_tangent(self._static, signal, seeds, wrt), None)
        zero = signal.with_values(np.zeros(len(signal.values)), "discrete" if signal.sampled else "zoh")
        inputs = [*seeds, *[zero] * len(wrt)]
        if self.relaxes:
            at, rates = state if isinstance(state, tuple) else (self._standing(signal, state), Rates.of(state))
            y, found, at, rates = self._relaxed.tangent(signal, inputs, wrt, at, rates)
            return Tangents(y, found, (at, rates))
        if isinstance(state, tuple):
            plain, tangents, dz = state
        else:
            plain = tangents = self._started(signal, state)
            dz = np.zeros(len(inputs))
            if state == STEADY:
                e = _plus(signal[:1], self.sign * plain.z)
                dz = self._solved_rates(e, [seed[:1] for seed in inputs], wrt, plain)
        outputs, rates = [], []
        for n in range(len(signal.values)):
            u, du = signal[n : n + 1], [seed[n : n + 1] for seed in inputs]
            z = plain.z
            if self.solve == "algebraic":
                z = self._solved(u, plain)
                dz = self._solved_rates(_plus(u, self.sign * z), du, wrt, tangents)
            e, de = _plus(u, self.sign * z), [_plus(d, self.sign * float(r)) for d, r in zip(du, dz, strict=True)]
            y, dy, tangents, dz = self._round(e, de, wrt, tangents)
            plain = self._stepped(e, plain) if self.solve == "algebraic" else plain._replace(z=tangents.z)
            outputs.append(y)
            rates.append(dy)
        return Tangents(joined(*outputs), [joined(*r) for r in zip(*rates, strict=True)], (plain, tangents, dz))

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the level at which the loop rests, by root finding."""

        def rest(e: float) -> tuple[float, _Loop]:
            y, forward = self.forward.steady(e, dt)
            z, back = (y, None) if self.back is None else self.back.steady(y, dt)
            return y, _Loop(forward, back, np.array([z]))

        e = root(lambda e: level + self.sign * float(rest(e)[1].z[0]) - e, level, "at rest")
        y, loop = rest(e)
        return y, None if self._instant else loop

    def _standing(self, u: Signal, state: State) -> Round:
        """Return where both blocks stand: at rest, steady at the first value, or where they were left."""
        if isinstance(state, Round):
            return state
        if isinstance(state, str):  # STEADY
            state = self.steady(float(u.values[0]), u.dt)[1]
        return Round(state.forward, state.back) if isinstance(state, _Loop) else Round(state, state)

    @property
    def relaxes(self) -> bool:
        """Tell whether it is solved by going round."""
        return self.solve == "continuous" and not self._instant

    @property
    def _relaxed(self) -> Relaxed:
        return Relaxed(self.forward, self.back, self.sign)

    @property
    def _instant(self) -> bool:
        return self.solve != "delay" and memoryless(self.forward) and (self.back is None or memoryless(self.back))

    @property
    def _static(self) -> StaticLoop:
        return StaticLoop(self.forward, self.back, self.sign)

    def _started(self, u: Signal, state: State) -> _Loop:
        """Return a loop at rest, or (STEADY) with both blocks steady: then what comes back is known already."""
        loop = _Loop(state, state)
        return loop._replace(z=self._solved(u[:1], loop)) if state == STEADY else loop

    def _stepped(self, e: Signal, loop: _Loop) -> _Loop:
        y, forward = self.forward.step(e, loop.forward)
        w, back = (y, None) if self.back is None else self.back.step(y, loop.back)
        return _Loop(forward, back, w.values[:1])

    def _solved(self, u: Signal, loop: _Loop) -> Floats:
        """Return z at a sample: the e that gives itself back, the states before the sample given."""
        trial = _only(u)

        def residual(e: float) -> float:
            return float(u.values[0]) + self.sign * float(self._stepped(trial.with_values(np.array([e])), loop).z[0]) - e

        e = root(residual, float(u.values[0] + self.sign * loop.z[0]), f"at t = {u.t0:g} s")
        return self._stepped(trial.with_values(np.array([e])), loop).z

    def _round(
        self, e: Signal, de: Sequence[Signal], wrt: Sequence[str], loop: _Loop
    ) -> tuple[Signal, list[Signal], _Loop, Floats]:
        """Go round once with the derivatives: every column is a seed, and a block's own numbers add to theirs."""
        y, dy, forward = _added(self.forward, e, de, wrt, "forward.", loop.forward)
        w, dw, back = (y, dy, None) if self.back is None else _added(self.back, y, dy, wrt, "back.", loop.back)
        return y, dy, _Loop(forward, back, w.values[:1]), np.array([d.values[0] for d in dw])

    def _solved_rates(self, e: Signal, du: Sequence[Signal], wrt: Sequence[str], loop: _Loop) -> Floats:
        """Return dz at a sample: it is affine in de, so two rounds give its slope g, and dz = dz₀/(1 − sign·g)."""
        trial, seeds = _only(e), [_only(d) for d in du]
        *_, first = self._round(trial, seeds, wrt, loop)
        *_, second = self._round(trial, [_plus(d, 1.0) for d in seeds], wrt, loop)
        return np.asarray(first / (1 - self.sign * (second - first)))


class _Loop(NamedTuple):
    """The state of a loop: of both blocks, and what comes back."""

    forward: Any = None
    back: Any = None
    z: Floats = np.zeros(1)  # an array: a number that a free initial state may change


def _plus(signal: Signal, level: Floats | float) -> Signal:
    return pointwise(lambda values: values + level, [signal], lambda courses: courses[0].impulses)


def _only(signal: Signal) -> Signal:
    """Return a one-sample signal without its course between samples: a trial needs the sample only."""
    return signal.with_values(signal.values, "discrete" if signal.sampled else "zoh")


def _added(
    block: Block, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], prefix: str, state: State
) -> tuple[Signal, list[Signal], State]:
    """Return a block's output and derivatives, the last len(wrt) columns with the block's own numbers added."""
    mine = [k for k, name in enumerate(wrt) if name.startswith(prefix)]
    out, along, state = block.tangent(signal, seeds, [wrt[k][len(prefix) :] for k in mine], state)
    columns, first = list(along[: len(seeds)]), len(seeds) - len(wrt)
    for k, own in zip(mine, along[len(seeds) :], strict=True):
        columns[first + k] = total([columns[first + k], own])
    return out, columns, state
