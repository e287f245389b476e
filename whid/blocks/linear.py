"""Linear dynamic block, continuous or discrete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Gt, MinLen
from numpy.typing import NDArray

from whid.blocks._block import Block, Number, State, Tangents
from whid.errors import WhidError
from whid.signal import Floats, Impulses, Panels, Signal, Splits, at, rule

Matrix = tuple[tuple[float, ...], ...]


class StateSpace(NamedTuple):
    """x′ = A x + B u, y = C x + D u (continuous: x′ = dx/dt; discrete: the next x)."""

    a: NDArray[Any]  # (s, s)
    b: NDArray[Any]  # (s,)
    c: NDArray[Any]  # (s,)
    d: Any


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
        resolvent = np.linalg.solve(s[..., None, None] * np.eye(len(b)) - a, np.broadcast_to(b[:, None], (*s.shape, len(b), 1)))
        return np.asarray(c @ resolvent[..., 0, None])[..., 0] + d

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
        return _filter(_realise(self, signal.dt, signal.order), signal, state)

    def tangent(self, signal: Signal, seeds: Sequence[Signal], wrt: Sequence[str], state: State = None) -> Tangents:
        """Filter the seeds like the signal; a coefficient's derivative is the response of the augmented system."""
        self._check_rate(signal)
        own, seed_states, wrt_states = state or (None, [None] * len(seeds), [None] * len(wrt))
        realised = _realise(self, signal.dt, signal.order)
        output, own = _filter(realised, signal, own)
        along = [_filter(realised, seed, s) for seed, s in zip(seeds, seed_states, strict=True)]
        rates = [
            _filter(_realise(self, signal.dt, signal.order, name), signal, s)
            for name, s in zip(wrt, wrt_states, strict=True)
        ]
        state = (own, [s for _, s in along], [s for _, s in rates])
        return Tangents(output, [y for y, _ in along] + [y for y, _ in rates], state)

    def steady(self, level: float, dt: float) -> tuple[float, State]:
        """Return G(0)·level and the state that stays there."""
        r = _realise(self, self.dt or dt, 4)
        with np.errstate(all="ignore"):
            try:
                x = np.linalg.solve(np.eye(len(r.phi)) - r.phi, r.gamma) * level
            except np.linalg.LinAlgError:
                x = np.array([np.inf])
        if not np.all(np.isfinite(x)) or np.abs(x).max(initial=0.0) > 1e12 * max(abs(level), 1e-300):
            raise WhidError("block-no-steady-state", "a linear block with a pole at 0 has no steady state")
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


class _Realised(NamedTuple):
    """A block on a grid, in Schur coordinates: Φ is triangular, so the recursion is a cascade of first-order filters."""

    phi: NDArray[Any]  # (s, s) upper triangular
    gamma: NDArray[Any]  # (s,) response of the state to an input held over one interval
    c: NDArray[Any]  # (s,)
    d: float
    nodes_c: NDArray[Any]  # (q, s) C·exp(A τ_q h)
    nodes_w: Floats  # (q, q) what the input at node p adds to the output at node q within the interval
    state_w: NDArray[Any]  # (s, q) what the input at node p adds to the next state
    kernel: NDArray[Any]  # (k, s) Legendre coefficients in 2τ − 1 of h·exp(A h τ)·B
    kernel_c: Floats  # (k,) the same of h·C·exp(A h τ)·B
    flow_c: NDArray[Any]  # (k, s) the same of C·exp(A h τ)
    numerator: Floats  # of the sampled path, b for lfilter
    denominator: Floats
    to_zi: NDArray[Any] | None  # (s, s) state to lfilter's delays; None when that is ill-conditioned
    discrete: bool


@lru_cache(maxsize=512)
def _realise(block: Linear, dt: float, q: int, wrt: str | None = None) -> _Realised:
    from scipy.linalg import expm, schur

    a, b, c, d = block.state_space() if wrt is None else _augmented(block, wrt)
    s = len(b)
    if s:
        real = bool(np.all(np.abs(np.linalg.eigvals(a).imag) <= 0))
        t, z = schur(a, output="real" if real else "complex")
        if real and np.abs(np.tril(t, -1)).max(initial=0.0) > 0:
            t, z = schur(a, output="complex")
        b, c = z.conj().T @ b, c @ z
    else:
        t = np.zeros((0, 0))
    if block.dt is not None:
        empty = np.zeros((0, s))
        phi, gamma, state_w, nodes_c, nodes_w = t, b, np.zeros((s, q)), np.zeros((q, s)), np.zeros((q, q))
        kernel, kernel_c, flow_c = empty, np.zeros(0), empty
    else:
        phi = np.triu(expm(t * dt))
        flow = [expm(t * dt * tau) for tau in rule(q).nodes]
        nodes_c = np.array([c @ f for f in flow]).reshape(q, s)
        integrals = [_product_integral(t * dt, b * dt, q, tau) for tau in (*rule(q).nodes, 1.0)]
        state_w, nodes_w = integrals[-1], np.real(np.array([c @ w for w in integrals[:-1]])).reshape(q, q)
        gamma = state_w.sum(axis=1)
        k = int(24 + 3 * np.abs(np.diag(t)).max(initial=0.0) * dt)
        x, _ = np.polynomial.legendre.leggauss(k)
        fit = np.linalg.inv(np.polynomial.legendre.legvander(x, k - 1))
        flows = np.array([expm(t * dt * (xi + 1) / 2) for xi in x]).reshape(k, s, s)
        kernel, flow_c = fit @ (flows @ b * dt), fit @ (c @ flows)
        kernel_c = np.real(fit @ (flows @ b * dt @ c))
    numerator, denominator, to_zi = _direct_form(phi, gamma, c, d)
    return _Realised(
        phi, gamma, c, float(np.real(d)), nodes_c, nodes_w, state_w, kernel, kernel_c, flow_c,
        numerator, denominator, to_zi, block.dt is not None,
    )  # fmt: skip


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


def _product_integral(a: NDArray[Any], b: NDArray[Any], q: int, tau: float) -> NDArray[Any]:
    """Return ∫₀^τ exp(a(τ−s)) b ℓ_p(s) ds for the Lagrange polynomials ℓ_p of the nodes: one augmented exponential."""
    from scipy.linalg import expm

    s = len(b)
    derivative = np.zeros((q, q))  # P_j′ = Σ derivative[j, i] P_i in the coordinate 2s − 1
    for j in range(q):
        for i in range(j - 1, -1, -2):
            derivative[j, i] = 2 * (2 * i + 1)
    generator = np.zeros((s + q, s + q), a.dtype)
    result = np.zeros((s, q), a.dtype)
    generator[:s, :s], generator[s:, s:] = a, derivative
    start = (-1.0) ** np.arange(q)  # P_j at s = 0
    for j in range(q):
        generator[:s, s:] = 0
        generator[:s, s + j] = b
        result[:, j] = expm(generator * tau)[:s, s:] @ start
    return np.asarray(result @ rule(q).to_legendre)


def _direct_form(phi: NDArray[Any], gamma: NDArray[Any], c: NDArray[Any], d: Any) -> tuple[Floats, Floats, Any]:
    """Return the transfer function of the sampled recursion and the map from the state to lfilter's delays."""
    s = len(phi)
    den = np.real(np.atleast_1d(np.poly(np.diag(phi)))) if s else np.ones(1)
    markov, x = [np.real(d)], gamma
    for _ in range(s):
        markov.append(np.real(c @ x))
        x = phi @ x
    num = np.convolve(markov, den)[: s + 1]
    observe = np.array([c @ np.linalg.matrix_power(phi, k) for k in range(s)]).reshape(s, s)
    # free response of lfilter's transposed form: y = den⁻¹ · zi, so zi = T(den)·observe·x
    toeplitz = np.array([[den[i - j] if 0 <= i - j else 0.0 for j in range(s)] for i in range(s)]).reshape(s, s)
    to_zi = toeplitz @ observe
    clustered = s > 0 and (np.linalg.cond(to_zi) > 1e7 or s > 6)
    return num, den, None if clustered else to_zi


def _filter(r: _Realised, signal: Signal, state: State) -> tuple[Signal, State]:
    from scipy.signal import lfilter

    s, n = len(r.phi), len(signal.values)
    x0 = np.zeros(s, r.phi.dtype) if state is None else np.asarray(state)
    if not s and not callable(signal.between):
        return signal.with_values(r.d * signal.values), x0
    if signal.sampled and r.to_zi is not None:
        y, zf = lfilter(r.numerator, r.denominator, signal.values, zi=np.real(r.to_zi @ x0))
        return signal.with_values(y), np.linalg.solve(r.to_zi, zf)
    if r.discrete or not callable(signal.between):
        drive = r.gamma[:, None] * signal.values
    else:
        drive = r.state_w @ signal.panels.values
        if len(signal.panels.splits.index) or len(signal.panels.impulses.index):
            _correct(r, signal.panels, signal.dt, drive)
    x = np.empty((s, n), drive.dtype)
    last = np.empty(s, drive.dtype)
    for k in range(s - 1, -1, -1):
        source = drive[k] + r.phi[k, k + 1 :] @ x[k + 1 :] if k < s - 1 else drive[k]
        x[k], zf = lfilter([0.0, 1.0], [1.0, -r.phi[k, k]], source, zi=[x0[k]])
        last[k] = zf[0]
    y = np.real(r.c @ x) + r.d * signal.values
    if signal.sampled:
        return signal.with_values(y), last
    if r.discrete:  # a digital filter holds its output
        return signal.with_values(y, "zoh"), last
    return signal.with_values(y, lambda: _between(r, signal, x)), last


def _correct(r: _Realised, panels: Panels, dt: float, drive: NDArray[Any]) -> None:
    """Replace the drive of split intervals by the sum over their sub-panels; add impulses."""
    s, i = panels.splits, panels.impulses
    if len(s.index):
        drive[:, s.index] = 0.0
        rest = 1 - (s.start + s.width * rule(len(s.values)).nodes[:, None])
        weight = rule(len(s.values)).weights[:, None] * s.width * s.values
        for k in range(len(drive)):
            np.add.at(drive[k], s.index, (_series(r.kernel[:, k], rest) * weight).sum(axis=0))
    for k in range(len(drive)):
        np.add.at(drive[k], i.index, _series(r.kernel[:, k], 1 - i.at) / dt * i.area)


def _series(coefficients: NDArray[Any], tau: Floats) -> NDArray[Any]:
    return np.asarray(np.polynomial.legendre.legval(2 * tau - 1, coefficients))


def _between(r: _Realised, signal: Signal, x: NDArray[Any]) -> Panels:
    """Return the output at the nodes: free motion of the state plus what the input adds within the interval."""
    free = np.real(r.nodes_c @ x)
    if not callable(signal.between):
        return Panels(free + (r.nodes_w.sum(axis=1) + r.d)[:, None] * signal.values)
    panels = signal.panels
    dense = free + r.nodes_w @ panels.values + r.d * panels.values
    s, i = panels.splits, panels.impulses
    if not len(s.index):
        return Panels(dense)
    return Panels(dense, s._replace(values=_inside(r, s, i, x, signal.dt)))


def _inside(r: _Realised, s: Splits, i: Impulses, x: NDArray[Any], dt: float) -> Floats:
    """Return the output at the nodes of every sub-panel; an impulse always falls where a sub-panel starts."""
    q = len(s.values)
    nodes, weights = rule(q).nodes, rule(q).weights
    t = s.start + s.width * nodes[:, None]  # (q, m)
    out = np.zeros_like(t)
    for k in range(len(x)):
        out += np.real(_series(r.flow_c[:, k], t) * x[k, s.index])
    for node in range(q):  # the part of the own sub-panel before each node
        inner = nodes[node] * nodes[:, None] * np.ones(len(s.index))
        lag = nodes[node] * s.width * (1 - nodes[:, None])
        part = _series(r.kernel_c, lag) * at(s.values, inner) * weights[:, None]
        out[node] += part.sum(axis=0) * nodes[node] * s.width
    later = 1
    while later < len(s.index) and (same := s.index[later:] == s.index[:-later]).any():
        ahead, behind = np.flatnonzero(same) + later, np.flatnonzero(same)
        for node in range(q):  # an earlier sub-panel of the same interval, whole
            lag = t[node, ahead] - t[:, behind]
            part = _series(r.kernel_c, lag) * s.values[:, behind] * weights[:, None]
            out[node, ahead] += part.sum(axis=0) * s.width[behind]
        later += 1
    for index, when, area in zip(*i, strict=True):
        mine = np.flatnonzero(s.index == index)
        lag = t[:, mine] - when
        out[:, mine] += np.where(lag >= 0, _series(r.kernel_c, np.abs(lag)) / dt * area, 0.0)
    return out + r.d * s.values
