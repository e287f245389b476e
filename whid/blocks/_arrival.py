"""What an input adds to a linear system within every interval: nodes, sub-panels, impulses, few rows of a stack."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from whid.blocks._realised import Array
from whid.signal import NO_IMPULSES, Floats, Ints, Panels, Signal, Splits, legendre_at, rule


def lagged(signal: Signal, weights: Floats, kernel: Floats) -> Floats:
    """Return Σ_l z⁻ˡ drive_l, l = 1 … s, and what of it comes behind the last interval: (…, N + s)."""
    n, s = signal.samples, len(weights)
    if signal.sparse is None:
        drive = arrived(signal, weights, kernel)
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
        added(out[:rows], few.hit + lag, few.struck[:, lag - 1])
    return out[:rows]


def arrived(signal: Signal, weights: Array, kernel: Array) -> Array:
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
        added(drive[:rows], few.hit, few.struck)
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
    struck = series(kernel, 1 - i.at) / signal.dt * i.area[..., None, :] if len(i.interval) else np.empty((0, 0, 0))
    return _Few(dense, tuple(parts), i.interval, struck)


def _from_panels(panels: Panels, dt: float, weights: Array, kernel: Array, share: Array | None) -> Array:
    drive = _product(weights, panels.values)
    s, i = panels.splits, panels.impulses
    if share is not None:
        first = np.flatnonzero(np.diff(s.interval, prepend=-1))
        drive[..., s.interval[first]] = np.add.reduceat(_weighed(share, s.values), first, axis=-1)
    if len(i.interval):
        added(drive, i.interval, series(kernel, 1 - i.at) / dt * i.area[..., None, :])
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
        series(kernel, 1 - (s.start + s.width * rule(q).nodes[:, None])) * (rule(q).weights[:, None] * s.width)
    )


def _weighed(share: Array, values: Floats) -> Array:
    """Return Σ over the nodes of share·values (…, s, m); values (…, q, m)."""
    found = share[:, 0] * values[..., None, 0, :]
    for node in range(1, values.shape[-2]):
        found += share[:, node] * values[..., None, node, :]
    return np.asarray(found)


def added(out: Array, index: Any, values: Array) -> None:
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


def series(coefficients: Array, tau: Floats) -> Array:
    """Return Legendre series (k, …) in 2τ − 1 at τ of any shape: (…, *τ.shape)."""
    terms = legendre_at(tau.ravel(), len(coefficients))
    found = _product(coefficients.reshape(len(coefficients), -1).T, terms)
    return np.asarray(found.reshape(*coefficients.shape[1:], *tau.shape))
