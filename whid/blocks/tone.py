"""A steady tone and its harmonics, added to what comes in: hum picked up on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, MinLen

from whid.blocks._block import Block, Free, State, Tangents
from whid.blocks._split import total
from whid.errors import WhidError
from whid.signal import Floats, Panels, Signal, rule


@dataclass(frozen=True, kw_only=True)
class Tone(Block):
    """The same signal plus sines of a fixed phase, such as the mains leave on a measured output.

    w(t) = v(t) + Σ_k cos[k]·cos(h_k·ω·t) + sin[k]·sin(h_k·ω·t),  h = harmonics

            ∿
            │
    v ──►( + )──► w

    omega in rad/s, t the record's own time; cos and sin in output units, one a harmonic. The steady state leaves the tone
    out. Raises `WhidError("block-parameters")` for unequal lengths.

    >>> Tone(omega=3.141592653589793, cos=(0.1,), sin=(0.0,))([1.0, 1.0, 1.0], dt=1.0)
    array([1.1, 0.9, 1.1])
    """

    omega: Annotated[float, Free("rad/s", 0.0), Gt(0)]
    cos: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(1)]
    sin: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(1)]
    harmonics: Annotated[tuple[Annotated[int, Ge(1)], ...], MinLen(1)] = (1,)

    def __post_init__(self) -> None:
        if not len(self.cos) == len(self.sin) == len(self.harmonics):
            raise WhidError("block-parameters", "tone needs one cos and one sin a harmonic")

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Add the tone."""
        return total([signal, self._wave(signal, "")]), None

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Pass the seeds on; the tone's own numbers by their derivatives."""
        return Tangents(self.step(signal)[0], [*seeds, *(self._wave(signal, name) for name in wrt)], None)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return the level: the mean of the output."""
        return level, None

    def at(self, time: Floats, wrt: str = "") -> Floats:
        """Return the tone, or its derivative with respect to one of its numbers, at times in s (any shape)."""
        out = np.zeros(np.shape(time))
        head, _, place = wrt.partition(".")
        for k, (h, a, b) in enumerate(zip(self.harmonics, self.cos, self.sin, strict=True)):
            turn = h * self.omega * time
            if not wrt:
                out += a * np.cos(turn) + b * np.sin(turn)
            elif head == "omega":
                out += h * time * (b * np.cos(turn) - a * np.sin(turn))
            elif int(place) == k:
                out += np.cos(turn) if head == "cos" else np.sin(turn)
        return out

    def _wave(self, signal: Signal, wrt: str) -> Signal:
        time: Floats = np.asarray(signal.t0 + signal.dt * np.arange(len(signal.values)), np.float64)
        if signal.sampled:
            return signal.with_values(self.at(time, wrt))
        inside: Floats = np.asarray(time + rule(signal.order).nodes[:, None] * signal.dt, np.float64)
        return signal.with_values(self.at(time, wrt), lambda: Panels(self.at(inside, wrt)))
