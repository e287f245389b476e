"""A linear system discretised on a grid, and what happens within an interval."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from whid.signal import Floats, rule

Array = NDArray[Any]
CLUSTERED = 1e7  # condition of the map to lfilter's delays, beyond it the cascade runs, on samples
ROUNDING = 2e-15  # of the largest coefficient: what the projection on polynomials leaves of any function
SENSITIVE = 1e4  # what the direct form makes of rounding, beyond it the cascade runs, between samples


class StateSpace(NamedTuple):
    """x′ = A x + B u, y = C x + D u (continuous: x′ = dx/dt; discrete: the next x)."""

    a: Array  # (s, s)
    b: Array  # (s,)
    c: Array  # (s,), or (o, s) for several outputs
    d: Any  # or (o,)


class Direct(NamedTuple):
    """The sampled recursion as lfilter runs it."""

    num: Floats  # (s + 1,)
    den: Floats  # (s + 1,)
    to_zi: Array  # (s, s) the map from the state to lfilter's delays, which is that from an interval's drive to den·y, too
    exact: bool  # good to 1e-12, too
    weights: Floats  # (s, q) to_zi @ state_w
    kernel: Floats  # (k, s) Legendre coefficients of to_zi @ kernel


class Inner(NamedTuple):
    """What happens within an interval: how its nodes and its end depend on the state at its start and the input.

    With several outputs every map that ends in an output has a leading axis (o, …).
    """

    nodes_c: Array  # (q, s) C·exp(A τ_q h)
    nodes_w: Floats  # (q, q) what the input at node p adds to the output at node q
    state_w: Array  # (s, q) what the input at node p adds to the next state
    kernel: Array  # (k, s) Legendre coefficients in 2τ − 1 of h·exp(A h τ)·B
    kernel_c: Floats  # (k, …) the same of h·C·exp(A h τ)·B
    flow_c: Array  # (k, …, s) the same of C·exp(A h τ)


@dataclass(frozen=True, eq=False)
class Realised:
    """A system on a grid, in Schur coordinates: Φ is triangular, so the recursion is a cascade of first-order filters."""

    a: Array  # (s, s) upper triangular, times dt when continuous
    b: Array  # (s,) times dt when continuous
    c: Array  # (s,), or (o, s)
    d: Any  # a number, or (o,)
    phi: Array  # (s, s) upper triangular
    gamma: Array  # (s,) response of the state to an input held over one interval
    order: int
    discrete: bool
    basis: Array  # (s, s) unitary: basis @ state is real

    @cached_property
    def real(self) -> tuple[Floats, Floats]:
        """Return what nodes add to the next state (s, q) and the kernel (k, s), both in the real coordinates."""
        return np.real(self.basis @ self.inner.state_w), np.real(self.inner.kernel @ self.basis.T)

    @cached_property
    def direct(self) -> Direct | None:
        """Return the recursion as one filter, None where that is ill-conditioned (clustered poles)."""
        s = len(self.phi)
        if s > 6 or self.c.ndim > 1:
            return None
        poles = np.diag(self.phi)
        den = np.real(np.atleast_1d(np.poly(poles))) if s else np.ones(1)
        markov, observe, x, c = [float(self.d)], [], self.gamma, self.c
        for _ in range(s):
            markov.append(float(np.real(self.c @ x)))
            observe.append(c)
            x, c = self.phi @ x, c @ self.phi
        num = np.convolve(markov, den)[: s + 1]
        # free response of lfilter's transposed form: y = den⁻¹ · zi, so zi = T(den)·observe·x
        toeplitz = sum((den[k] * np.eye(s, k=-k) for k in range(s)), np.zeros((s, s)))
        to_zi = toeplitz @ np.array(observe).reshape(s, s)
        condition = float(np.linalg.cond(to_zi)) if s else 1.0
        if condition > CLUSTERED:
            return None
        circle = np.abs(np.polyval(den, np.exp(1j * np.angle(poles)))).min(initial=1.0)
        exact = s > 0 and max(condition, float(np.abs(den).sum() / max(float(circle), 1e-300))) < SENSITIVE
        if not exact or self.discrete:
            return Direct(num, den, to_zi, exact, np.empty((s, 0)), np.empty((0, s)))
        inner = self.inner
        return Direct(num, den, to_zi, exact, np.real(to_zi @ inner.state_w), np.real(inner.kernel @ to_zi.T))

    @cached_property
    def inner(self) -> Inner:
        """Return the maps of one interval."""
        q = self.order
        k = 8 * int(4 + 0.4 * np.abs(np.diag(self.a)).max(initial=0.0))
        flows = _flows(self.a, np.concatenate([rule(k).nodes, rule(q).nodes]))
        project, flow_c = rule(k).to_legendre, self.c @ flows  # (k + q, …, s)
        kernel = project @ (flows[:k] @ self.b)
        integrals = kernel.T @ _product_integrals(k, q)  # (q + 1, s, q)
        series = (project @ flow_c[:k].reshape(k, -1)).reshape(k, *flow_c.shape[1:])
        nodes_w = np.real(self.c @ integrals[:-1])  # (q, …, q)
        nodes_c = flow_c[k:]
        if self.c.ndim > 1:
            nodes_c, nodes_w = nodes_c.swapaxes(0, 1), nodes_w.swapaxes(0, 1)
        return Inner(nodes_c, nodes_w, integrals[-1], _short(kernel), _short(np.real(kernel @ self.c.T)), _short(series))


def _short(series: Array) -> Array:
    """Return a Legendre series without the coefficients behind the last one that is more than rounding."""
    size = np.abs(series).reshape(len(series), -1).max(axis=1, initial=0.0)
    return series[: 1 + int(np.flatnonzero(size > ROUNDING * size.max(initial=0.0)).max(initial=0))]


def _flows(a: Array, tau: Floats) -> Array:
    """Return exp(a·τ) for every τ in [0, 1]: (len(τ), s, s). By its power series where a is small, which is cheap."""
    from scipy.linalg import expm

    s = len(a)
    if not s:
        return np.zeros((len(tau), 0, 0))
    size = float(np.abs(a).sum(axis=0).max())
    if size > 2:
        return np.asarray(expm(a * tau[:, None, None]))
    terms, left, k = [np.eye(s, dtype=a.dtype)], 1.0, 0
    while left > 1e-18:
        k += 1
        left *= size / k
        terms.append(terms[-1] @ a / k)
    powers = tau[:, None] ** np.arange(k + 1)
    return np.asarray((powers @ np.array(terms).reshape(k + 1, -1)).reshape(len(tau), s, s))


def realise(system: StateSpace, dt: float, q: int, *, discrete: bool) -> Realised:
    """Return a system on the grid dt with q nodes an interval."""
    z, triangular = triangle(system.a)
    b, c = z.conj().T @ system.b, system.c @ z
    return gridded(StateSpace(triangular, b, c, np.real(system.d)), z, dt, q, discrete=discrete)


def triangle(a: Array) -> tuple[Array, Array]:
    """Return Z and T = ZᴴAZ, upper triangular (Schur)."""
    return _triangle(a.tobytes(), len(a)) if len(a) else (a, a)


@lru_cache(maxsize=64)
def _triangle(raw: bytes, s: int) -> tuple[Array, Array]:  # a filter and the family of its derivatives have it in common
    from scipy.linalg import schur

    a = np.frombuffer(raw).reshape(s, s)
    t: Array
    z: Array
    t, z = schur(a, output="real")
    if np.abs(np.tril(t, -1)).max(initial=0.0) > 0:  # a complex pair stands as a 2 by 2 block
        t, z = schur(a, output="complex")
    return z, t


def gridded(system: StateSpace, basis: Array, dt: float, q: int, *, discrete: bool) -> Realised:
    """Return a system whose A is upper triangular on the grid dt; basis @ state is real."""
    a, b, c, d = system
    s = len(b)
    if discrete:
        return Realised(a, b, c, d, a, b, q, True, basis)
    a, b = a * dt, b * dt
    whole = np.zeros((s + 1, s + 1), a.dtype)  # the input as one more, constant state
    whole[:s, :s], whole[:s, s] = a, b
    held = _flows(whole, np.ones(1))[0]
    return Realised(a, b, c, d, np.triu(held[:s, :s]), held[:s, s], q, False, basis)


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
