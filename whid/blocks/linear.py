"""Linear dynamic block, continuous or discrete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, MinLen
from numpy.typing import NDArray

from whid.blocks._block import PERIODIC, Block, Number, State, Tangents
from whid.blocks._filter import filtered
from whid.blocks._realised import Realised, StateSpace, gridded, realise, triangle
from whid.blocks._stack import Bundle, stacked
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

    def eigenvalues(self) -> NDArray[np.complex128]:
        """Return the poles, rad/s, or in z for a discrete block."""
        return _eigenvalues(self)

    def growing(self) -> complex | float | None:
        """Return the fastest pole right of the axis (outside the unit circle if discrete), None of a block without.

        >>> Linear(num=(1.0,), den=(1.0, -1.0)).growing(), Linear(num=(1.0,), den=(1.0, 0.0)).growing()
        (1.0, None)
        """
        poles = self.eigenvalues()
        rate = poles.real if self.dt is None else np.abs(poles) - 1
        if not np.any(rate > 1e-9 * (1 + np.abs(poles))):
            return None
        worst = complex(poles[np.argmax(rate)])
        return worst if worst.imag else worst.real

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
        fastest = float(np.abs(_eigenvalues(self)).max(initial=0.0)) * dt
        return next((q for limit, q in ((0.1, 4), (0.5, 6), (1.5, 8), (4.0, 12), (12.0, 24)) if fastest <= limit), 40)

    def step(self, signal: Signal, state: State = None) -> tuple[Signal, State]:
        """Filter a chunk; between samples the output is exact where the input is known there."""
        self._check_rate(signal)
        r = _realised(self, signal.dt, signal.order)
        return filtered(r, signal, _started(r, signal, state))

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Filter the seeds like the signal; its own numbers' derivatives are further outputs of one system (`_family`)."""
        self._check_rate(signal)
        realised = _realised(self, signal.dt, signal.order)
        runs = [(realised, signal), *([(realised, stacked(seeds))] if seeds else [])]
        runs += [(_family(self, signal.dt, signal.order, tuple(wrt)), signal)] if wrt else []
        states = state if isinstance(state, list) else [state] * len(runs)
        (out, first), *rest = [filtered(r, x, _started(r, x, s)) for (r, x), s in zip(runs, states, strict=True)]
        return Tangents(out, Bundle(stacked([y for y, _ in rest])) if rest else [], [first, *(s for _, s in rest)])

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
def _eigenvalues(block: Linear) -> NDArray[np.complex128]:
    return np.asarray(np.linalg.eigvals(block.state_space().a), complex)


@lru_cache(maxsize=512)
def _realised(block: Linear, dt: float, q: int) -> Realised:
    return realise(block.state_space(), dt, q, discrete=block.dt is not None)


@lru_cache(maxsize=512)
def _family(block: Linear, dt: float, q: int, names: tuple[str, ...]) -> Realised:
    """Return the system whose outputs are ∂y/∂name.

    With p = den/den[0] of degree n every derivative is P/p² for some polynomial P = D p² + Q p + R, so D u + Q(1/p)u +
    R(1/p²)u: all share the 2n states of (1/p²)u and (1/p)u.
    """
    num, den = block.transfer_function()
    monic, n = den / den[0], len(den) - 1
    a, b, *_ = _canonical(num, den)
    z, t = triangle(a)
    into, last = z.conj().T @ b, np.eye(1, n, n - 1)[0] @ z if n else np.zeros(0)
    outputs, through = [], []
    for name in names:
        rest = _numerator(block, name)
        feed, rest = rest[0], (rest - rest[0] * np.convolve(monic, monic))[1:]
        for k in range(n):  # division by p
            rest[k + 1 : k + n + 1] -= rest[k] * monic[1:]
        outputs.append(np.concatenate([rest[n:] @ z, rest[:n] @ z]))
        through.append(float(feed))
    whole, basis = np.zeros((2, 2 * n, 2 * n), t.dtype)
    whole[:n, :n], whole[:n, n:], whole[n:, n:] = t, np.outer(into, last), t
    basis[:n, :n] = basis[n:, n:] = z
    system = StateSpace(whole, np.concatenate([np.zeros(n), into]), np.array(outputs), np.array(through))
    return gridded(system, basis, dt, q, discrete=block.dt is not None)


def _numerator(block: Linear, name: str) -> Floats:
    """Return P (2n + 1,), descending, of ∂(num/den)/∂name = P/p²."""
    num, den = block.transfer_function()
    head, _, place = name.partition(".")
    if head == "den":  # −num·sᵏ/den²
        found = -np.append(num, np.zeros(len(den) - 1 - int(place))) / den[0] ** 2
    elif head == "num":  # sᵏ/den
        found = np.append(den, np.zeros(len(num) - 1 - int(place))) / den[0] ** 2
    else:
        found = np.convolve(np.real(np.atleast_1d(np.poly(block.zeros))), den)
    return np.concatenate([np.zeros(2 * len(den) - 1 - len(found)), found])


def _started(r: Realised, signal: Signal, state: State) -> State:
    if not isinstance(state, str) or state == PERIODIC or not signal.samples:
        return state
    return signal.once(lambda: _steady_state(r, signal.values[..., 0]), _steady_state, r, signal)


def _steady_state(r: Realised, level: Any) -> Any:
    """Return the state (…, s) that a constant input holds: x = Φx + Γ·level."""
    level = np.asarray(level)
    if not level.any():
        return np.zeros((*level.shape, len(r.phi)), r.phi.dtype)
    if np.any(np.abs(1 - np.diag(r.phi)) < 1e-13):  # Φ is triangular
        raise WhidError("block-no-steady-state", "a linear block with a pole at 0 has no steady state")
    return np.linalg.solve(np.eye(len(r.phi)) - r.phi, r.gamma) * level[..., None]
