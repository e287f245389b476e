"""A linear system on a grid: discretised, then run over samples or over panels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from whid.blocks._recursion import cascaded, direct
from whid.signal import NO_IMPULSES, Floats, Impulses, Ints, Panels, Signal, Splits, legendre_at, picked, rule

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


def filtered(r: Realised, signal: Signal, state: Any = None) -> tuple[Signal, Any]:
    """Return the output and the next state (None: from rest); exact between samples where the input is known there.

    A stack (p, N) gives a stack and a state (p, s); a system of several outputs gives a stack, one row an output.
    PERIODIC: from the state that the signal, one period, leads back to.
    """
    if signal.kept is None:
        return _filtered(r, signal, state)

    def made() -> tuple[Signal, Any]:
        out, last = _filtered(r, signal, state)
        return replace(out, kept=signal.kept), last

    found: tuple[Signal, Any] = signal.once(made, filtered, r, signal, state)
    return found


def _filtered(r: Realised, signal: Signal, state: Any) -> tuple[Signal, Any]:
    s, values = len(r.phi), signal.values
    if not signal.samples or (not s and not callable(signal.between)):
        rest = np.zeros((*values.shape[:-1], s), r.phi.dtype)
        return signal.with_values(_through(r, values)), rest if state is None else state
    form, states = r.direct, None
    if form is not None and (signal.sampled or not callable(signal.between)) and (signal.sampled or form.exact):
        y, last = direct(form.num, form.den, form.to_zi, r.phi, values, state)
    elif form is not None and form.exact and not r.discrete:
        y, last = _summed(r, form, signal, state)
    else:
        states = cascaded(r.phi, _drive(r, signal), state)
        last = states[1]
        y = _real(r.c, states[0]) + _through(r, values)
    if signal.sampled:
        return signal.with_values(y), last
    if r.discrete:  # a digital filter holds its output
        return signal.with_values(y, "zoh"), last
    return signal.with_values(y, lambda: _between(r, signal, (states or cascaded(r.phi, _drive(r, signal), state))[0])), last


def _through(r: Realised, values: Floats) -> Floats:
    return np.asarray(r.d * values if r.c.ndim == 1 else r.d[:, None] * values)


def _summed(r: Realised, form: Direct, signal: Signal, start: Any) -> tuple[Floats, Array]:
    """Return the samples and the last state by one filter of order s a signal: den(z)·y = Σ_l z⁻ˡ (to_zi @ drive)_l."""
    n = signal.samples
    source = _lagged(signal, form.weights, form.kernel)
    y, last = direct(np.ones(1), form.den, form.to_zi, r.phi, source[..., :n], start, source[..., n:])
    return y + _through(r, signal.values) if r.d else y, last


def _lagged(signal: Signal, weights: Floats, kernel: Floats) -> Floats:
    """Return Σ_l z⁻ˡ drive_l, l = 1 … s, and what of it comes behind the last interval: (…, N + s)."""
    n, s = signal.samples, len(weights)
    if signal.sparse is None:
        drive = _arrived(signal, weights, kernel)
        out = np.zeros((*signal.values.shape[:-1], n + s))
        for lag in range(1, s + 1):
            out[..., lag : lag + n] += drive[..., lag - 1, :]
        return out
    few, rows = _few(signal, weights, kernel), len(signal.values)
    out = np.zeros((rows + 1, n + s))  # the last one for what belongs to no row
    first = len(few.dense)
    for lag in range(1, s + 1):
        out[:first, lag : lag + n] += few.dense[:, lag - 1]
    for part in few.parts:
        at = np.where(part.place < 0, rows, part.place + first) * (n + s) + part.interval
        for lag in range(1, s + 1):
            np.add.at(out.reshape(-1), (at + lag).ravel(), part.drive[:, lag - 1].ravel())
    for lag in range(1, s + 1 if len(few.hit) else 0):
        _add(out[:rows], few.hit + lag, few.struck[:, lag - 1])
    return out[:rows]


def _drive(r: Realised, signal: Signal) -> Array:
    """Return what arrives at the state within every interval (…, s, N)."""
    if r.discrete or not callable(signal.between):
        return np.asarray(r.gamma[:, None] * signal.values[..., None, :])
    if np.iscomplexobj(r.inner.kernel):  # half the work in real coordinates
        return np.asarray(r.basis.conj().T @ _arrived(signal, *r.real))
    return _arrived(signal, r.inner.state_w, r.inner.kernel)


def _arrived(signal: Signal, weights: Array, kernel: Array) -> Array:
    """Return Σ weight·value over the nodes of every interval (…, s, N), or of its sub-panels; impulses too."""
    if signal.sparse is None:
        panels = signal.panels
        mine = _shares(signal, panels.splits, kernel, panels.values.shape[-2])
        return _from_panels(panels, signal.dt, weights, kernel, mine)
    few, rows = _few(signal, weights, kernel), len(signal.values)
    drive = np.zeros((rows + 1, len(weights), signal.samples), few.dense.dtype)  # the last one for what belongs to no row
    drive[: len(few.dense)] = few.dense
    target = drive[len(few.dense) :].swapaxes(1, 2)
    for part in few.parts:
        for place, value in zip(part.place, part.drive, strict=True):
            np.add.at(target, (place, part.interval), value.T)
    if len(few.hit):
        _add(drive[:rows], few.hit, few.struck)
    return drive[:rows]


class _Part(NamedTuple):
    """What arrives in the few rows of a sparse stack that are not 0 on an interval, or on a sub-panel."""

    place: Ints  # (r, m)
    interval: Ints  # (m,)
    drive: Array  # (r, s, m)


class _Few(NamedTuple):
    """What arrives within every interval in a sparse stack."""

    dense: Array  # (p₀, s, N)
    parts: tuple[_Part, ...]
    hit: Ints  # (k,) intervals with an impulse
    struck: Array  # (p, s, k) what arrives of it


def _few(signal: Signal, weights: Array, kernel: Array) -> _Few:
    assert signal.sparse is not None
    sparse = signal.sparse()
    s, i = sparse.dense.splits, sparse.dense.impulses
    share = _shares(signal, s, kernel, sparse.values.shape[-2])
    dense = _from_panels(sparse.dense._replace(impulses=NO_IMPULSES), signal.dt, weights, kernel, share)
    own = _product(weights, sparse.values)
    own[..., s.interval] = 0.0
    parts = [_Part(sparse.place, np.arange(signal.samples), own)]
    if share is not None:
        parts.append(_Part(sparse.split_place, s.interval, _weighed(share, sparse.split_values)))
    struck = _series(kernel, 1 - i.at) / signal.dt * i.area[..., None, :] if len(i.interval) else np.empty((0, 0, 0))
    return _Few(dense, tuple(parts), i.interval, struck)


def _from_panels(panels: Panels, dt: float, weights: Array, kernel: Array, share: Array | None) -> Array:
    drive = _product(weights, panels.values)
    s, i = panels.splits, panels.impulses
    if share is not None:
        first = np.flatnonzero(np.diff(s.interval, prepend=-1))
        drive[..., s.interval[first]] = np.add.reduceat(_weighed(share, s.values), first, axis=-1)
    if len(i.interval):
        _add(drive, i.interval, _series(kernel, 1 - i.at) / dt * i.area[..., None, :])
    return drive


def _shares(signal: Signal, s: Splits, kernel: Array, q: int) -> Array | None:
    """Return `_share` of a signal's sub-panels, None where it has none."""
    if not len(s.interval):
        return None
    found: Array = signal.once(lambda: _share(s, kernel, q), _share, s.start, s.width, kernel)
    return found


def _share(s: Splits, kernel: Array, q: int) -> Array:
    """Return what the value at each node of each sub-panel adds to the state at the end of its interval (s, q, m)."""
    return np.asarray(
        _series(kernel, 1 - (s.start + s.width * rule(q).nodes[:, None])) * (rule(q).weights[:, None] * s.width)
    )


def _weighed(share: Array, values: Floats) -> Array:
    """Return Σ over the nodes of share·values (…, s, m); values (…, q, m)."""
    found = share[:, 0] * values[..., None, 0, :]
    for node in range(1, values.shape[-2]):
        found += share[:, node] * values[..., None, node, :]
    return np.asarray(found)


def _add(out: Array, index: Any, values: Array) -> None:
    """Add values (…, m) to out (…, N) at an index (m,) that may repeat."""
    where: Any = (..., index)
    np.add.at(out, where, values)


def _product(matrix: Array, values: Floats) -> Array:
    """Return matrix @ values, without a complex copy of real values."""
    if not np.iscomplexobj(matrix):
        return np.asarray(matrix @ values)
    out = np.empty((*values.shape[:-2], len(matrix), values.shape[-1]), complex)
    out.real, out.imag = matrix.real @ values, matrix.imag @ values
    return out


def _real(matrix: Array, x: Array, *more: Floats) -> Floats:
    """Return the real part of matrix @ [x; more], real numbers below x, by one real product."""
    if not np.iscomplexobj(matrix):
        return np.asarray(matrix @ (np.concatenate([x, *more], axis=-2) if more else x))
    s = x.shape[-2]
    parts = matrix[..., :s].real, -matrix[..., :s].imag, matrix[..., s:].real
    return np.asarray(np.concatenate(parts, axis=-1) @ np.concatenate([x.real, x.imag, *more], axis=-2))


def _series(coefficients: Array, tau: Floats) -> Array:
    """Return Legendre series (k, …) in 2τ − 1 at τ of any shape: (…, *τ.shape)."""
    terms = legendre_at(tau.ravel(), len(coefficients))
    found = _product(coefficients.reshape(len(coefficients), -1).T, terms)
    return np.asarray(found.reshape(*coefficients.shape[1:], *tau.shape))


def _between(r: Realised, signal: Signal, x: Array) -> Panels:
    """Return the output at the nodes: free motion of the state plus what the input adds within the interval."""
    q, d = r.order, r.d if r.c.ndim == 1 else r.d[:, None, None]
    through = r.inner.nodes_w + d * np.eye(q)
    held = not callable(signal.between)
    panels = Panels(signal.values[..., None, :]) if held else signal.panels
    into = through.sum(axis=-1, keepdims=True) if held else through
    maps = np.concatenate([r.inner.nodes_c, into], axis=-1)  # one product, as a matrix of real numbers
    dense = _real(maps.reshape(-1, maps.shape[-1]), x, panels.values).reshape(*x.shape[:-2], *maps.shape[:-1], -1)
    if held:
        return Panels(dense)
    s, i = panels.splits, panels.impulses
    hits = i._replace(area=_through(r, i.area)) if np.any(r.d) and len(i.at) else NO_IMPULSES
    if not len(s.interval):
        return Panels(dense, impulses=hits)
    return Panels(dense, s._replace(values=_inside(r, s, i, x, signal.dt) + d * s.values), hits)


def _inside(r: Realised, s: Splits, i: Impulses, x: Array, dt: float) -> Floats:
    """Return C x at the nodes of every sub-panel; an impulse always falls where a sub-panel starts."""
    q = s.values.shape[-2]
    nodes, weights = rule(q).nodes, rule(q).weights
    t = s.start + s.width * nodes[:, None]  # (q, m)
    flow = _series(r.inner.flow_c, t)  # (…, s, q, m)
    start = picked(x, s.interval)
    out = np.zeros((*x.shape[:-2], *r.c.shape[:-1], *t.shape))
    for k in range(x.shape[-2]):
        out += np.real(flow[..., k, :, :] * start[..., k, None, :])
    for node in range(q):  # the part of the own sub-panel before each node
        course = legendre.legvander(2 * nodes[node] * nodes - 1, q - 1) @ rule(q).to_legendre @ s.values
        lag = nodes[node] * s.width * (1 - nodes[:, None])
        part = _series(r.inner.kernel_c, lag) * course * weights[:, None]
        out[..., node, :] += part.sum(axis=-2) * nodes[node] * s.width
    later = 1
    while later < len(s.interval) and (same := s.interval[later:] == s.interval[:-later]).any():
        ahead, behind = np.flatnonzero(same) + later, np.flatnonzero(same)
        for node in range(q):  # an earlier sub-panel of the same interval, whole
            part = _series(r.inner.kernel_c, t[node, ahead] - t[:, behind]) * picked(s.values, behind) * weights[:, None]
            out[..., node, ahead] += part.sum(axis=-2) * s.width[behind]
        later += 1
    first, last = np.searchsorted(s.interval, i.interval), np.searchsorted(s.interval, i.interval, side="right")
    for step in range(int((last - first).max(initial=0))):  # each impulse on the step-th sub-panel of its interval
        hit = first + step < last
        mine = (first + step)[hit]
        lag = t[:, mine] - i.at[hit]
        share = np.where(lag >= 0, _series(r.inner.kernel_c, np.abs(lag)), 0.0) / dt
        _add(out, mine, share * i.area[..., None, hit])
    return np.asarray(out)
