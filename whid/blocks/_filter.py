"""A linear system on a grid, run over samples or over panels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from whid.blocks._arrival import added, arrived, lagged, series
from whid.blocks._realised import Array, Direct, Realised
from whid.blocks._recursion import cascaded, direct
from whid.signal import NO_IMPULSES, Floats, Impulses, Panels, Signal, Splits, picked, rule


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
    source = lagged(signal, form.weights, form.kernel)
    y, last = direct(np.ones(1), form.den, form.to_zi, r.phi, source[..., :n], start, source[..., n:])
    return y + _through(r, signal.values) if r.d else y, last


def _drive(r: Realised, signal: Signal) -> Array:
    """Return what arrives at the state within every interval (…, s, N)."""
    if r.discrete or not callable(signal.between):
        return np.asarray(r.gamma[:, None] * signal.values[..., None, :])
    if np.iscomplexobj(r.inner.kernel):  # half the work in real coordinates
        return np.asarray(r.basis.conj().T @ arrived(signal, *r.real))
    return arrived(signal, r.inner.state_w, r.inner.kernel)


def _real(matrix: Array, x: Array, *more: Floats) -> Floats:
    """Return the real part of matrix @ [x; more], real numbers below x, by one real product."""
    if not np.iscomplexobj(matrix):
        return np.asarray(matrix @ (np.concatenate([x, *more], axis=-2) if more else x))
    s = x.shape[-2]
    parts = matrix[..., :s].real, -matrix[..., :s].imag, matrix[..., s:].real
    return np.asarray(np.concatenate(parts, axis=-1) @ np.concatenate([x.real, x.imag, *more], axis=-2))


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
    flow = series(r.inner.flow_c, t)  # (…, s, q, m)
    start = picked(x, s.interval)
    out = np.zeros((*x.shape[:-2], *r.c.shape[:-1], *t.shape))
    for k in range(x.shape[-2]):
        out += np.real(flow[..., k, :, :] * start[..., k, None, :])
    for node in range(q):  # the part of the own sub-panel before each node
        course = legendre.legvander(2 * nodes[node] * nodes - 1, q - 1) @ rule(q).to_legendre @ s.values
        lag = nodes[node] * s.width * (1 - nodes[:, None])
        part = series(r.inner.kernel_c, lag) * course * weights[:, None]
        out[..., node, :] += part.sum(axis=-2) * nodes[node] * s.width
    later = 1
    while later < len(s.interval) and (same := s.interval[later:] == s.interval[:-later]).any():
        ahead, behind = np.flatnonzero(same) + later, np.flatnonzero(same)
        for node in range(q):  # an earlier sub-panel of the same interval, whole
            part = series(r.inner.kernel_c, t[node, ahead] - t[:, behind]) * picked(s.values, behind) * weights[:, None]
            out[..., node, ahead] += part.sum(axis=-2) * s.width[behind]
        later += 1
    first, last = np.searchsorted(s.interval, i.interval), np.searchsorted(s.interval, i.interval, side="right")
    for step in range(int((last - first).max(initial=0))):  # each impulse on the step-th sub-panel of its interval
        hit = first + step < last
        mine = (first + step)[hit]
        lag = t[:, mine] - i.at[hit]
        share = np.where(lag >= 0, series(r.inner.kernel_c, np.abs(lag)), 0.0) / dt
        added(out, mine, share * i.area[..., None, hit])
    return np.asarray(out)
