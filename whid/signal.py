"""A signal on a uniform grid, and what it does between its samples.

A block gets a `Signal` and returns one. Between samples a signal is nothing (`discrete`, the sampled path), held
(`zoh`), or a polynomial on each interval given by its values at Gauss-Legendre nodes (`Panels`, the exact path).
An interval that a breakpoint of a hard nonlinearity crosses is split where it crosses, so that every panel is smooth.

Several signals on one grid are one `Signal` whose arrays have a leading axis: values (p, N), panels (p, q, N), the same
splits for all (see `blocks/_stack.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Array = NDArray[Any]
Ints = NDArray[np.intp]


class Rule(NamedTuple):
    """Gauss-Legendre rule on [0, 1]."""

    nodes: Floats  # (q,)
    weights: Floats  # (q,)
    to_legendre: Floats  # (q, q) node values -> Legendre coefficients in 2τ − 1
    ends: Floats  # (2, q) node values -> values at τ = 0 and 1


@lru_cache
def rule(q: int) -> Rule:
    """Return the q-node Gauss-Legendre rule on [0, 1] and its interpolation matrices.

    >>> bool(abs(rule(4).weights @ rule(4).nodes ** 7 - 1 / 8) < 1e-15)
    True
    """
    x, weights = legendre.leggauss(q)
    to_legendre = np.asarray(np.linalg.inv(legendre.legvander(x, q - 1)), np.float64)
    return Rule((x + 1) / 2, weights / 2, to_legendre, legendre.legvander(np.array([-1.0, 1.0]), q - 1) @ to_legendre)


class Splits(NamedTuple):
    """Sub-panels of the intervals that are not smooth, sorted by interval, then start; they tile their interval."""

    interval: Ints  # (m,)
    start: Floats  # (m,) in [0, 1)
    width: Floats  # (m,)
    values: Floats  # (…, q, m) at start + width·nodes


class Impulses(NamedTuple):
    """Dirac impulses (only tangents have them: the derivative of a jump that moves in time)."""

    interval: Ints  # (m,)
    at: Floats  # (m,) in [0, 1]
    area: Floats  # (…, m) signal units × s


NO_SPLITS = Splits(np.empty(0, np.intp), np.empty(0), np.empty(0), np.empty((0, 0)))
NO_IMPULSES = Impulses(np.empty(0, np.intp), np.empty(0), np.empty(0))


class Panels(NamedTuple):
    """Node values on every interval [t_n, t_n + dt); those of a split interval stand in `splits` instead."""

    values: Floats  # (…, q, n)
    splits: Splits = NO_SPLITS
    impulses: Impulses = NO_IMPULSES


class Sparse(NamedTuple):
    """The panels of a stack (p rows): the first rows as they are, and of the rest the few that are not 0 on each panel.

    On interval n row place[k, n] is values[k, :, n]; likewise on the sub-panels, whose borders stand in `dense`. A place of
    −1 is no row. `dense` has the first rows; the impulses in it are those of all.
    """

    dense: Panels  # (p₀, q, n)
    place: Ints  # (r, n)
    values: Floats  # (r, q, n)
    split_place: Ints  # (r, m)
    split_values: Floats  # (r, q, m)


Between = Literal["discrete", "zoh"] | Callable[[], Panels]


class Kept:
    """What was made of a record's signals for one model: a trial's, which need not be made again for its linearisation.

    Found again by the very objects it was made of. It only grows while it is open; it belongs to whoever clears it.

    >>> kept, block = Kept(), object()
    >>> kept.open = True
    >>> kept.once(lambda: "a", block), kept.once(lambda: "b", block), kept.once(lambda: "c", object())
    ('a', 'a', 'c')
    """

    def __init__(self) -> None:
        self.open = False
        self._known: dict[tuple[int, ...], tuple[tuple[Any, ...], Any]] = {}

    def __len__(self) -> int:
        return len(self._known)

    def once(self, make: Callable[[], Any], *of: Any) -> Any:
        """Return what was made of these objects, or make it."""
        key = tuple(map(id, of))
        if key in self._known:
            return self._known[key][1]
        made = make()
        if self.open:
            self._known[key] = of, made  # they stay as long as their ids are a key
        return made

    def clear(self, *, open: bool = False) -> None:
        """Forget everything, and keep what is made from now on or not."""
        self._known.clear()
        self.open = open


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples x(t0 + n·dt), n = 0 … N−1, and the signal's course between them.

    values  (N,), or (p, N) for a stack
    dt      sampling time, s
    t0      time of the first sample, s
    between "discrete", "zoh", or a function that returns the `Panels` (called once, when somebody needs them)
    order   number of nodes an interval (q)
    sparse  the same panels of a stack of mostly zeros, made for a fraction of the cost; None where that is all there is
    kept    where blocks keep what they make of the signal; None where nobody asks twice
    """

    values: Floats
    dt: float
    t0: float = 0.0
    between: Between = "discrete"
    order: int = 4
    sparse: Callable[[], Sparse] | None = None
    kept: Kept | None = None

    @cached_property
    def panels(self) -> Panels:
        """Return the course between samples as panels; a held signal is constant on each."""
        if callable(self.between):
            return self.between()
        shape = (*self.values.shape[:-1], self.order, self.samples)
        return Panels(np.broadcast_to(self.values[..., None, :], shape))

    @property
    def samples(self) -> int:
        """Return N."""
        return int(self.values.shape[-1])

    @property
    def sampled(self) -> bool:
        """Tell whether the signal is known at its samples only."""
        return self.between == "discrete"

    def with_values(self, values: Floats, between: Between | None = None) -> Signal:
        """Return a signal on the same grid."""
        return Signal(values, self.dt, self.t0, self.between if between is None else between, self.order)

    def once(self, make: Callable[[], Any], *of: Any) -> Any:
        """Return what was made of these objects, or make it."""
        return make() if self.kept is None else self.kept.once(make, *of)

    def __getitem__(self, part: slice) -> Signal:
        """Return a stretch of the signal, its course between samples included."""
        first, last, _ = part.indices(self.samples)
        between: Between = self.between if not callable(self.between) else lambda: cut(self.panels, first, last)
        return Signal(self.values[..., first:last], self.dt, self.t0 + first * self.dt, between, self.order)


def cut(panels: Panels, first: int, last: int) -> Panels:
    """Return the panels of the intervals first … last − 1, renumbered from 0."""
    s, i = panels.splits, panels.impulses
    low, high = np.searchsorted(s.interval, (first, last))
    hit = (i.interval >= first) & (i.interval < last)
    keep = slice(low, high)
    splits = NO_SPLITS
    if high > low:
        splits = Splits(s.interval[keep] - first, s.start[keep], s.width[keep], s.values[..., keep])
    impulses = Impulses(i.interval[hit] - first, i.at[hit], i.area[..., hit]) if hit.any() else NO_IMPULSES
    return Panels(panels.values[..., first:last], splits, impulses)


def held(values: Floats, dt: float, intersample: str, t0: float = 0.0, order: int = 4) -> Signal:
    """Return the signal of an input whose course between samples is declared.

    `zoh` holds, `foh` joins the samples by straight lines, `bandlimited` interpolates by the trigonometric polynomial
    through them (mirrored at the ends, so that a record that is not periodic does not ring), `discrete` is the sampled path.

    >>> held(np.array([0.0, 1.0, 1.0]), 0.1, "foh").panels.values[:, 0].round(2)
    array([0.07, 0.33, 0.67, 0.93])
    """
    if intersample in ("discrete", "zoh"):
        return Signal(values, dt, t0, "zoh" if intersample == "zoh" else "discrete", order)
    nodes = rule(order).nodes
    if intersample == "foh":
        following = np.append(values[1:], values[-1:])
        return Signal(values, dt, t0, lambda: Panels(values + nodes[:, None] * (following - values)), order)
    return Signal(values, dt, t0, lambda: Panels(_bandlimited(values, nodes)), order)


def joined(*signals: Signal) -> Signal:
    """Return signals one after another, the course between samples of each kept.

    >>> joined(Signal(np.zeros(1), 0.1), Signal(np.ones(2), 0.1, t0=0.1)).values
    array([0., 1., 1.])
    """
    values, last = np.concatenate([signal.values for signal in signals], axis=-1), signals[-1]
    inner = not last.sampled and any(callable(signal.between) for signal in signals)

    def panels() -> Panels:  # one that is held is constant on as many nodes as the others have
        return _joined([(s if callable(s.between) else replace(s, order=last.order)).panels for s in signals])

    between: Between = panels if inner else last.between
    return Signal(values, last.dt, signals[0].t0, between, last.order)


def _joined(panels: list[Panels]) -> Panels:
    first = np.cumsum([0, *(p.values.shape[-1] for p in panels)])
    splits = [
        p.splits._replace(interval=p.splits.interval + n)
        for p, n in zip(panels, first, strict=False)
        if len(p.splits.interval)
    ]
    hits = [
        p.impulses._replace(interval=p.impulses.interval + n)
        for p, n in zip(panels, first, strict=False)
        if len(p.impulses.at)
    ]
    return Panels(
        np.concatenate([p.values for p in panels], axis=-1),
        Splits(*(np.concatenate(column, axis=-1) for column in zip(*splits, strict=True))) if splits else NO_SPLITS,
        Impulses(*(np.concatenate(column, axis=-1) for column in zip(*hits, strict=True))) if hits else NO_IMPULSES,
    )


def _bandlimited(values: Floats, nodes: Floats) -> Floats:
    if not len(values):
        return np.empty((len(nodes), 0))
    mirrored = np.concatenate([values, values[-2:0:-1]])
    spectrum, line = np.fft.rfft(mirrored), np.arange(len(mirrored) // 2 + 1)
    shifts = np.exp(2j * np.pi * nodes[:, None] * line / len(mirrored))
    return np.asarray(np.fft.irfft(spectrum * shifts, len(mirrored))[:, : len(values)])


def at(values: Floats, tau: Floats) -> Floats:
    """Interpolate panels: node values (…, q, m) at local coordinates tau (m,) or (k, m) in [0, 1] of each panel.

    Returns (…, m) or (…, k, m).
    """
    q = values.shape[-2]
    share = rule(q).to_legendre.T @ legendre_at(tau.ravel(), q)  # (q, …): what every node contributes
    shares = share.reshape(q, *tau.shape)
    if tau.ndim == 1:
        return np.asarray(np.einsum("qm,...qm->...m", shares, values), float)
    return np.asarray(np.einsum("qkm,...qm->...km", shares, values), float)


def picked(values: Array, index: Ints) -> Array:
    """Return values[..., index] with its last axis contiguous: indexing puts the index first in memory, then all is slow.

    >>> picked(np.arange(6.0).reshape(2, 3), np.array([2, 0])).tolist()
    [[2.0, 0.0], [5.0, 3.0]]
    """
    return np.asarray(np.take(values, index, axis=-1))


def legendre_at(tau: Floats, count: int) -> Floats:
    """Return P₀ … P_{count−1} in 2τ − 1, (count, m): numpy's vander transposed, which is written in order.

    >>> legendre_at(np.array([0.0, 0.5, 1.0]), 3)
    array([[ 1. ,  1. ,  1. ],
           [-1. ,  0. ,  1. ],
           [ 1. , -0.5,  1. ]])
    """
    x, out = 2 * tau - 1, np.empty((count, len(tau)))
    out[0] = 1.0
    if count > 1:
        out[1] = x
    for n in range(2, count):  # n Pₙ = (2n − 1) x Pₙ₋₁ − (n − 1) Pₙ₋₂
        np.multiply(x, out[n - 1], out=out[n])
        out[n] *= (2 * n - 1) / n
        out[n] -= (n - 1) / n * out[n - 2]
    return out


def rms(x: Any) -> float:
    """Return the root mean square of what is finite, NaN of nothing.

    >>> rms([3.0, -3.0, float("nan")])
    3.0
    """
    finite = np.asarray(x, float)[np.isfinite(x)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else float("nan")


class Spread(NamedTuple):
    """Count, mean and sum of squares about the mean of numbers seen bit by bit.

    >>> Spread.of(np.array([1.0, 2.0])).joined(Spread.of(np.array([6.0])))
    Spread(size=3, mean=3.0, squares=14.0)
    """

    size: int = 0
    mean: float = 0.0
    squares: float = 0.0

    @classmethod
    def of(cls, x: Floats) -> Spread:
        """Return that of numbers that are all here."""
        mean = float(x.mean()) if len(x) else 0.0
        away = x - mean
        return cls(len(x), mean, float(away @ away))

    def joined(self, other: Spread) -> Spread:
        """Return that of both together."""
        count = self.size + other.size
        if not count:
            return self
        step, share = other.mean - self.mean, other.size / count
        return Spread(count, self.mean + step * share, self.squares + other.squares + step**2 * self.size * share)

    @property
    def std(self) -> float:
        """Return the standard deviation, of the population."""
        return float(np.sqrt(self.squares / self.size)) if self.size else float("nan")
