"""Linear dynamic block, continuous or discrete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, MinLen
from numpy.typing import NDArray

from whid.blocks._block import Block, Number, State, Tangents
from whid.blocks._filter import Realised, StateSpace, filtered, realise
from whid.errors import WhidError
from whid.signal import Floats, Signal

Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Linear(Block):
    """Transfer function num/den, zeros/poles/gain, or state space; continuous (s) or, with `dt`, discrete (z).

    G(s) = (num[0] s^m + … + num[m]) / (den[0] s^n + … + den[n]), coefficients descending as in `control` and scipy.

          ┌──────────┐
    u ──► │ num/den  │ ──► y
          └──────────┘

    Exactly one of the three forms. Units: s in rad/s. Raises `WhidError("block-parameters")` for an improper transfer
    function or mixed forms. A continuous block is simulated exactly: the state by its matrix exponential, what arrives
    between samples by product integration on Gauss-Legendre nodes [PAPERS A, build 1].

    >>> Linear(num=(1.0,), den=(1.0, 1.0))(np.ones(3), dt=1.0).round(4)
    array([0.    , 0.6321, 0.8647])
    """

    num: Annotated[tuple[Number, ...], MinLen(1)] | None = None
    den: Annotated[tuple[Number, ...], MinLen(1)] | None = None
    zeros: tuple[complex, ...] = ()
    poles: tuple[complex, ...] | None = None
    gain: Number | None = None
    A: Matrix | None = None
    B: tuple[float, ...] | None = None
    C: tuple[float, ...] | None = None
    D: float = 0.0
    dt: Annotated[float, Gt(0)] | None = None

    def __post_init__(self) -> None:
        forms = [self.num is not None and self.den is not None, self.poles is not None, self.A is not None]
        mixed = (self.num is None) != (self.den is None)
        if sum(forms) != 1 or mixed:
            raise WhidError("block-parameters", "linear needs exactly one of num + den, poles (+ zeros, gain), A + B + C")
        if self.poles is not None and len(self.zeros) > len(self.poles):
            raise WhidError("block-parameters", "linear has more zeros than poles")
        if self.num is not None and self.den is not None:
            if self.den[0] == 0:
                raise WhidError("block-parameters", "den[0] is the leading coefficient and must not be 0")
            if len(self.num) > len(self.den):
                raise WhidError("block-parameters", f"num has degree {len(self.num) - 1} above den's {len(self.den) - 1}")
        if self.A is not None:
            s = len(self.A)
            if any(len(row) != s for row in self.A) or len(self.B or ()) != s or len(self.C or ()) != s:
                raise WhidError("block-parameters", f"A must be {s} by {s}, B and C of length {s}")

    @classmethod
    def of(cls, system: Any) -> Linear:
        """Return the block of a `control.TransferFunction` or `control.StateSpace` (one input, one output).

        >>> import control
        >>> Linear.of(control.tf([1.0], [1.0, 2.0])).den
        (1.0, 2.0)
        """
        dt = float(system.dt) if system.dt not in (None, 0, True) else None
        if hasattr(system, "num"):
            num, den = np.trim_zeros(system.num[0][0], "f"), np.trim_zeros(system.den[0][0], "f")
            return cls(num=tuple(map(float, num)) or (0.0,), den=tuple(map(float, den)), dt=dt)
        a, b, c = np.asarray(system.A), np.asarray(system.B)[:, 0], np.asarray(system.C)[0]
        return cls(
            A=tuple(tuple(map(float, row)) for row in a),
            B=tuple(map(float, b)),
            C=tuple(map(float, c)),
            D=float(np.asarray(system.D)[0, 0]),
            dt=dt,
        )

    def control(self) -> Any:
        """Return the block as a `control` object: a transfer function, or a state space where it was given as one."""
        import control

        if self.A is not None:
            return control.ss(self.A, np.array(self.B)[:, None], np.array([self.C]), self.D, self.dt or 0)
        return control.tf(*self.transfer_function(), self.dt or 0)

    def transfer_function(self) -> tuple[Floats, Floats]:
        """Return (num, den), descending."""
        if self.num is not None and self.den is not None:
            return np.array(self.num), np.array(self.den)
        if self.poles is not None:
            gain = 1.0 if self.gain is None else self.gain
            return np.real(np.atleast_1d(gain * np.poly(self.zeros))), np.real(np.atleast_1d(np.poly(self.poles)))
        a, b, c, d = self.state_space()
        den = np.real(np.atleast_1d(np.poly(a)))
        return np.real(np.poly(a - np.outer(b, c))) + (d - 1) * den, den

    def state_space(self) -> StateSpace:
        """Return the controllable canonical form of num/den, or A, B, C, D as given."""
        if self.A is not None:
            return StateSpace(np.array(self.A).reshape(len(self.A), -1), np.array(self.B), np.array(self.C), self.D)
        num, den = self.transfer_function()
        return _canonical(num, den)

    def gain_at(self, omega: Floats) -> NDArray[np.complex128]:
        """Return G(jω), or G(e^{jω·dt}) for a discrete block; omega in rad/s, any shape."""
        s = 1j * np.asarray(omega) if self.dt is None else np.exp(1j * np.asarray(omega) * self.dt)
        if self.A is None:
            num, den = self.transfer_function()
            return np.asarray(np.polyval(num, s) / np.polyval(den, s))
        a, b, c, d = self.state_space()
        column = np.broadcast_to(b[:, None], (*s.shape, len(b), 1))
        resolvent = np.linalg.solve(s[..., None, None] * np.eye(len(b)) - a, column)
        return np.asarray((c @ resolvent)[..., 0] + d)

    def panel_order(self, dt: float) -> int:
        """Return the nodes an interval needs so that three times the fastest pole is resolved to 1e-10."""
        if self.dt is not None:
            return 4
        a = self.state_space().a
        fastest = float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)) * dt
        return next((q for limit, q in ((0.1, 4), (0.5, 6), (1.5, 8), (4.0, 12), (12.0, 24)) if fastest <= limit), 40)

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Filter a chunk; between samples the output is exact where the input is known there."""
        self._check_rate(signal)
        r = _realised(self, signal.dt, signal.order)
        return filtered(r, signal, _started(r, signal, state))

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Filter the seeds like the signal; a coefficient's derivative is the response of the augmented system."""
        self._check_rate(signal)
        realised = _realised(self, signal.dt, signal.order)
        runs = [(realised, signal), *((realised, seed) for seed in seeds)]
        runs += [(_realised(self, signal.dt, signal.order, name), signal) for name in wrt]
        states = state if isinstance(state, list) else [state] * len(runs)
        done = [filtered(r, x, _started(r, x, s)) for (r, x), s in zip(runs, states, strict=True)]
        return Tangents(done[0][0], [y for y, _ in done[1:]], [s for _, s in done])

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return G(0)·level and the state that stays there."""
        r = _realised(self, self.dt or dt, 4)
        x = _steady_state(r, level)
        return float(np.real(r.c @ x) + r.d * level), x

    def _check_rate(self, signal: Signal) -> None:
        if self.dt is not None and abs(self.dt - signal.dt) > 1e-9 * self.dt:
            raise WhidError("block-parameters", f"a discrete block of dt {self.dt:g} s met a signal of dt {signal.dt:g} s")


def _canonical(num: NDArray[Any], den: NDArray[Any]) -> StateSpace:
    n = len(den) - 1
    num = np.concatenate([np.zeros(n + 1 - len(num)), num]) / den[0]
    den = den / den[0]
    a = np.eye(n, k=-1, dtype=den.dtype)
    if n:
        a[0] = -den[1:]
    return StateSpace(a, np.eye(1, n)[0].astype(a.dtype), num[1:] - num[0] * den[1:], num[0])


@lru_cache(maxsize=512)
def _realised(block: Linear, dt: float, q: int, wrt: str | None = None) -> Realised:
    return realise(block.state_space() if wrt is None else _augmented(block, wrt), dt, q, discrete=block.dt is not None)


def _augmented(block: Linear, name: str) -> StateSpace:
    """Return the system whose output is ∂y/∂name: (A, B, C, D) beside their derivatives, by a complex step."""
    head, _, place = name.partition(".")
    num, den = (np.array(x, complex) for x in block.transfer_function())
    if head == "gain":
        return StateSpace(*_canonical(np.real(num) / (block.gain or 1.0), np.real(den)))
    step = 1e-30
    target = num if head == "num" else den
    target[int(place)] += 1j * step
    a, b, c, d = _canonical(num, den)
    (a, da), (b, db), (c, dc), (d, dd) = ((np.real(x), np.imag(x) / step) for x in (a, b, c, d))
    zero = np.zeros_like(a)
    return StateSpace(np.block([[a, zero], [da, a]]), np.concatenate([b, db]), np.concatenate([dc, c]), dd)


def _started(r: Realised, signal: Signal, state: State) -> State:
    return _steady_state(r, float(signal.values[0])) if isinstance(state, str) and len(signal.values) else state


def _steady_state(r: Realised, level: float) -> Any:
    """Return the state that a constant input holds: x = Φx + Γ·level."""
    if level == 0:
        return np.zeros(len(r.phi), r.phi.dtype)
    if np.any(np.abs(1 - np.diag(r.phi)) < 1e-13):  # Φ is triangular
        raise WhidError("block-no-steady-state", "a linear block with a pole at 0 has no steady state")
    return np.linalg.solve(np.eye(len(r.phi)) - r.phi, r.gamma) * level
