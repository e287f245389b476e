"""A linear system on a grid: discretised, then run over samples or over panels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from whid.signal import NO_IMPULSES, Floats, Impulses, Panels, Signal, Splits, at, rule


class StateSpace(NamedTuple):
    """x′ = A x + B u, y = C x + D u (continuous: x′ = dx/dt; discrete: the next x)."""

    a: NDArray[Any]  # (s, s)
    b: NDArray[Any]  # (s,)
    c: NDArray[Any]  # (s,)
    d: Any


class Inner(NamedTuple):
    """What happens within an interval: how its nodes and its end depend on the state at its start and the input."""

    nodes_c: NDArray[Any]  # (q, s) C·exp(A τ_q h)
    nodes_w: Floats  # (q, q) what the input at node p adds to the output at node q
    state_w: NDArray[Any]  # (s, q) what the input at node p adds to the next state
    kernel: NDArray[Any]  # (k, s) Legendre coefficients in 2τ − 1 of h·exp(A h τ)·B
    kernel_c: Floats  # (k,) the same of h·C·exp(A h τ)·B
    flow_c: NDArray[Any]  # (k, s) the same of C·exp(A h τ)


@dataclass(frozen=True, eq=False)
class Realised:
    """A system on a grid, in Schur coordinates: Φ is triangular, so the recursion is a cascade of first-order filters."""

    a: NDArray[Any]  # (s, s) upper triangular, times dt when continuous
    b: NDArray[Any]  # (s,) times dt when continuous
    c: NDArray[Any]  # (s,)
    d: float
    phi: NDArray[Any]  # (s, s) upper triangular
    gamma: NDArray[Any]  # (s,) response of the state to an input held over one interval
    order: int
    discrete: bool

    @cached_property
    def direct(self) -> tuple[Floats, Floats, NDArray[Any] | None]:
        """Return b and a of the sampled recursion for lfilter, and the map from the state to its delays.

        The map is None where it is ill-conditioned (clustered poles): the cascade is used instead.
        """
        s = len(self.phi)
        den = np.real(np.atleast_1d(np.poly(np.diag(self.phi)))) if s else np.ones(1)
        markov, observe, x, c = [self.d], [], self.gamma, self.c
        for _ in range(s):
            markov.append(float(np.real(self.c @ x)))
            observe.append(c)
            x, c = self.phi @ x, c @ self.phi
        num = np.convolve(markov, den)[: s + 1]
        # free response of lfilter's transposed form: y = den⁻¹ · zi, so zi = T(den)·observe·x
        toeplitz = sum((den[k] * np.eye(s, k=-k) for k in range(s)), np.zeros((s, s)))
        to_zi = toeplitz @ np.array(observe).reshape(s, s)
        clustered = s > 6 or (s > 0 and np.linalg.cond(to_zi) > 1e7)
        return num, den, None if clustered else to_zi

    @cached_property
    def inner(self) -> Inner:
        """Return the maps of one interval."""
        from scipy.linalg import expm

        s, q = len(self.b), self.order
        k = 8 * int(4 + 0.4 * np.abs(np.diag(self.a)).max(initial=0.0))
        nodes = np.concatenate([rule(k).nodes, rule(q).nodes])
        flows = expm(self.a * nodes[:, None, None]) if s else np.zeros((k + q, 0, 0))
        kernel, flow_c = rule(k).to_legendre @ (flows[:k] @ self.b), rule(k).to_legendre @ (self.c @ flows[:k])
        integrals = kernel.T @ _product_integrals(k, q)
        nodes_w, kernel_c = np.real(self.c @ integrals[:-1]), np.real(kernel @ self.c)
        return Inner(self.c @ flows[k:], nodes_w, integrals[-1], kernel, kernel_c, flow_c)


def realise(system: StateSpace, dt: float, q: int, *, discrete: bool) -> Realised:
    """Return a system on the grid dt with q nodes an interval."""
    from scipy.linalg import expm, schur

    a, b, c, d = system
    s = len(b)
    if s:
        a, z = schur(a, output="real")
        if np.abs(np.tril(a, -1)).max(initial=0.0) > 0:  # a complex pair stands as a 2 by 2 block
            a, z = schur(system.a, output="complex")
        b, c = z.conj().T @ b, c @ z
    if discrete:
        return Realised(a, b, c, float(np.real(d)), a, b, q, True)
    a, b = a * dt, b * dt
    held = expm(np.block([[a, b[:, None]], [np.zeros((1, s + 1))]]))  # the input as one more, constant state
    return Realised(a, b, c, float(np.real(d)), np.triu(held[:s, :s]), held[:s, s], q, False)


@lru_cache
def _product_integrals(k: int, q: int) -> Floats:
    """Return M (q + 1, k, q): ∫₀^τ K(τ − s) ℓ_p(s) ds = Σ_j K_j M[·, j, p] at τ = every node and 1.

    K_j are the Legendre coefficients of a kernel, ℓ_p the Lagrange polynomials of the nodes.
    """
    inner, out = rule(k + q), []
    for tau in (*rule(q).nodes, 1.0):
        lagrange = legendre.legvander(2 * tau * inner.nodes - 1, q - 1) @ rule(q).to_legendre
        lag = legendre.legvander(2 * tau * (1 - inner.nodes) - 1, k - 1)
        out.append(lag.T @ (tau * inner.weights[:, None] * lagrange))
    return np.array(out)


def filtered(r: Realised, signal: Signal, state: Any = None) -> tuple[Signal, Any]:
    """Return the output and the next state (None: from rest); exact between samples where the input is known there."""
    from scipy.signal import lfilter

    s, n = len(r.phi), len(signal.values)
    x0 = np.zeros(s, r.phi.dtype) if state is None else np.asarray(state)
    if not n or (not s and not callable(signal.between)):
        return signal.with_values(r.d * signal.values), x0
    if signal.sampled:
        numerator, denominator, to_zi = r.direct
        if to_zi is not None:
            y, zf = lfilter(numerator, denominator, signal.values, zi=np.real(to_zi @ x0))
            return signal.with_values(y), np.linalg.solve(to_zi, zf)
    if r.discrete or not callable(signal.between):
        drive = r.gamma[:, None] * signal.values
    else:
        drive = r.inner.state_w @ signal.panels.values
        if len(signal.panels.splits.interval) or len(signal.panels.impulses.interval):
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


def _correct(r: Realised, panels: Panels, dt: float, drive: NDArray[Any]) -> None:
    """Replace the drive of split intervals by the sum over their sub-panels; add impulses."""
    s, i = panels.splits, panels.impulses
    if len(s.interval):
        drive[:, s.interval] = 0.0
        rest = 1 - (s.start + s.width * rule(len(s.values)).nodes[:, None])
        weight = rule(len(s.values)).weights[:, None] * s.width * s.values
        for k in range(len(drive)):
            np.add.at(drive[k], s.interval, (_series(r.inner.kernel[:, k], rest) * weight).sum(axis=0))
    for k in range(len(drive)):
        np.add.at(drive[k], i.interval, _series(r.inner.kernel[:, k], 1 - i.at) / dt * i.area)


def _series(coefficients: NDArray[Any], tau: Floats) -> NDArray[Any]:
    return np.asarray(legendre.legval(2 * tau - 1, coefficients))


def _between(r: Realised, signal: Signal, x: NDArray[Any]) -> Panels:
    """Return the output at the nodes: free motion of the state plus what the input adds within the interval."""
    free = np.real(r.inner.nodes_c @ x)
    if not callable(signal.between):
        return Panels(free + (r.inner.nodes_w.sum(axis=1) + r.d)[:, None] * signal.values)
    panels = signal.panels
    dense = free + r.inner.nodes_w @ panels.values + r.d * panels.values
    s, i = panels.splits, panels.impulses
    through = i._replace(area=r.d * i.area) if r.d else NO_IMPULSES
    if not len(s.interval):
        return Panels(dense, impulses=through)
    return Panels(dense, s._replace(values=_inside(r, s, i, x, signal.dt)), through)


def _inside(r: Realised, s: Splits, i: Impulses, x: NDArray[Any], dt: float) -> Floats:
    """Return the output at the nodes of every sub-panel; an impulse always falls where a sub-panel starts."""
    q = len(s.values)
    nodes, weights = rule(q).nodes, rule(q).weights
    t = s.start + s.width * nodes[:, None]  # (q, m)
    out = np.zeros_like(t)
    for k in range(len(x)):
        out += np.real(_series(r.inner.flow_c[:, k], t) * x[k, s.interval])
    for node in range(q):  # the part of the own sub-panel before each node
        inner = nodes[node] * nodes[:, None] * np.ones(len(s.interval))
        lag = nodes[node] * s.width * (1 - nodes[:, None])
        part = _series(r.inner.kernel_c, lag) * at(s.values, inner) * weights[:, None]
        out[node] += part.sum(axis=0) * nodes[node] * s.width
    later = 1
    while later < len(s.interval) and (same := s.interval[later:] == s.interval[:-later]).any():
        ahead, behind = np.flatnonzero(same) + later, np.flatnonzero(same)
        for node in range(q):  # an earlier sub-panel of the same interval, whole
            lag = t[node, ahead] - t[:, behind]
            part = _series(r.inner.kernel_c, lag) * s.values[:, behind] * weights[:, None]
            out[node, ahead] += part.sum(axis=0) * s.width[behind]
        later += 1
    first, last = np.searchsorted(s.interval, i.interval), np.searchsorted(s.interval, i.interval, side="right")
    for step in range(int((last - first).max(initial=0))):  # each impulse on the step-th sub-panel of its interval
        hit = first + step < last
        mine = (first + step)[hit]
        lag = t[:, mine] - i.at[hit]
        np.add.at(out.T, mine, np.where(lag >= 0, _series(r.inner.kernel_c, np.abs(lag)) / dt * i.area[hit], 0.0).T)
    return out + r.d * s.values
