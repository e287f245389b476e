"""All that the stages of a curve without memory need of the samples: sums, made in one pass over chunks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from whid.fit import normal_equations
from whid.signal import Floats
from whid.stages._cells import Cells
from whid.stages._chebyshev import CHUNK, Domain, Moments, basis, empty, moments, scaled
from whid.stages._local_lines import Seen, Windows

HEAD = 1 << 16  # samples behind the pilot


class Samples(NamedTuple):
    """A chunk of samples whose order does not count: input, output (N,), and the inputs before, (L, N)."""

    x: Floats
    y: Floats
    earlier: Floats

    def part(self, part: slice) -> Samples:
        """Return some of them."""
        return Samples(self.x[part], self.y[part], self.earlier[:, part])


class CurveSums(NamedTuple):
    """Sums over the samples in the domain, r = y − pilot: what is squared is small, so that nothing cancels."""

    domain: Domain
    pilot: Floats  # (K + 1,) Chebyshev coefficients
    left: Moments  # of r, to the order K + extra
    beyond: Moments  # of r outside the domain, to the order K
    square: float  # Σ y²
    crossed: Floats  # (K + 1, L) Σ T_k·earlier
    lags: Floats  # (L, L) Σ earlier·earlier
    lag_products: Floats  # (L,) Σ earlier·r
    seen: Seen  # outside the domain as well

    @property
    def order(self) -> int:
        """Return K."""
        return len(self.pilot) - 1

    def rest(self, coefficients: Floats) -> float:
        """Return Σ (y − Σ cₖ Tₖ)² of all samples, those outside the domain as well.

        >>> x = np.linspace(-2, 2, 101)
        >>> round(curve_sums(one_chunk(x, x**2), 2, (-1.0, 1.0)).rest(np.array([0.0, 0.0, 0.5])), 9)
        25.25
        """
        change, size = coefficients - self.pilot, self.order + 1
        inside, outside = (
            m.square - float(change @ (2 * m.products[:size] - m.gram(self.order) @ change)) for m in (self.left, self.beyond)
        )
        return max(0.0, inside) + max(0.0, outside)


def one_chunk(x: Floats, y: Floats, earlier: Floats | None = None) -> list[Samples]:
    """Return arrays as the only chunk there is."""
    return [Samples(x, y, np.empty((0, len(x))) if earlier is None else earlier)]


def curve_sums(
    chunks: Iterable[Samples], order: int, domain: Domain, extra: int | None = None, windows: Sequence[Windows] = ()
) -> CurveSums:
    """Return the sums of all chunks in one pass, and those of the windows.

    The pilot is least squares of the first 65 536 samples. extra: terms beyond K (left out: K + 1). Where the chunks are cut
    does not matter but for rounding.

    >>> x = np.linspace(-1, 1, 1001)
    >>> two = [*one_chunk(x[:7], x[:7]), *one_chunk(x[7:], x[7:])]
    >>> whole, parts = (curve_sums(chunks, 3, (-1.0, 1.0)) for chunks in (one_chunk(x, x), two))
    >>> bool(np.allclose(whole.left.sums, parts.left.sums)), whole.left.samples
    (True, 1001)
    """
    wide = order + (order + 1 if extra is None else extra)
    head, rest = _head(iter(chunks))
    lags = len(head[0].earlier) if head else 0
    work = _Work(domain, wide, _pilot(head, order, domain), windows, lags)
    for chunk in _small(chain(head, rest)):
        work.add(*chunk)
    for each in windows:
        each.collect(work.cells)
    return work.found()


class _Work:
    """The sums under way."""

    def __init__(self, domain: Domain, wide: int, pilot: Floats, windows: Sequence[Windows], lags: int) -> None:
        self.domain, self.pilot, self.size, self.sorts = domain, pilot, len(pilot), bool(windows)
        self.left, self.beyond = empty(wide), empty(len(pilot) - 1)
        self.crossed, self.inner, self.lagged = np.zeros((self.size, lags)), np.zeros((lags, lags)), np.zeros(lags)
        self.square, self.seen = 0.0, Seen(np.inf, -np.inf, 0)
        self.outside: list[tuple[Floats, Floats]] = []
        self.before = np.empty((lags, CHUNK))
        edges = np.array([-1.0, np.nextafter(1.0, 2.0)])
        self.cells = Cells(np.concatenate([edges, *(each.cuts for each in windows)]), self.size)
        self.domain_cells = self.cells.between(*edges)
        self.rows = np.empty((max(wide, self.size) + 1, CHUNK))

    def add(self, x: Floats, y: Floats, earlier: Floats) -> None:
        """Add a chunk of samples."""
        if not len(x):
            return
        t = scaled(x, self.domain)
        low, high = float(t.min()), float(t.max())
        self.seen = Seen(min(low, self.seen.low), max(high, self.seen.high), self.seen.samples + len(t))
        order, inside = None, slice(0, len(t))
        if self.sorts or low < -1 or high > 1:
            grouped = self.cells.group(t)
            order = grouped.order
            t, y = t[order], y[order]
            first, last = self.domain_cells[0], self.domain_cells[-1]
            inside = slice(grouped.until(first), grouped.until(last + 1))
        rows = basis(t, len(self.rows) - 1, self.rows[:, : len(t)])
        if self.sorts:
            self.cells.add(grouped, t, y, rows)
        r = y - self.pilot @ rows[: self.size]
        if inside != slice(0, len(t)):
            self._outside(*(np.delete(each, inside) for each in (t, r)))
        r, y, rows, wide = r[inside], y[inside], rows[:, inside], len(self.left.products) - 1
        self.left = self.left.joined(moments(t[inside], r, wide, rows[: wide + 1]))
        self.square += float(y @ y)
        for k, row in enumerate(earlier):
            self.before[k, : len(r)] = row[inside if order is None else order[inside]]
        self._lags(scaled(self.before[:, : len(r)], self.domain), r, rows[: self.size])

    def _lags(self, before: Floats, r: Floats, rows: Floats) -> None:
        for k, row in enumerate(before):
            self.crossed[:, k] += rows @ row  # one by one: a product of few long rows is slower
            self.inner[k, k:] += before[k:] @ row
            self.lagged[k] += row @ r

    def _outside(self, t: Floats, r: Floats) -> None:
        """Add samples outside the domain: a few of every chunk, gathered until they are many."""
        self.outside.append((t, r))
        if sum(len(each) for each, _ in self.outside) > CHUNK:
            self._gathered()

    def _gathered(self) -> None:
        for t, r in [np.hstack(self.outside)] if self.outside else []:
            self.beyond = self.beyond.joined(moments(t, r, self.size - 1))
        self.outside = []

    def found(self) -> CurveSums:
        """Return what was summed."""
        self._gathered()
        self.inner += np.triu(self.inner, 1).T
        return CurveSums(
            self.domain, self.pilot, self.left, self.beyond, self.square, self.crossed, self.inner, self.lagged, self.seen
        )


def _pilot(head: Iterable[Samples], order: int, domain: Domain) -> Floats:
    """Return the least-squares coefficients of the first samples."""
    known = empty(order)
    for x, y, _ in _small(head):
        t = scaled(x, domain)
        inside = np.abs(t) <= 1
        known = known.joined(moments(t, y, order) if inside.all() else moments(t[inside], y[inside], order))
    return normal_equations(known.gram(order), known.products, known.square, known.samples).values


def _head(chunks: Iterator[Samples]) -> tuple[list[Samples], Iterator[Samples]]:
    """Return the first HEAD samples, and what follows them."""
    head: list[Samples] = []
    missing = HEAD
    for chunk in chunks:
        head.append(chunk.part(slice(0, missing)))
        if len(chunk.x) > missing:
            return head, chain([chunk.part(slice(missing, None))], chunks)
        missing -= len(chunk.x)
    return head, chunks


def _small(chunks: Iterable[Samples]) -> Iterator[Samples]:
    """Yield samples in chunks whose basis stays in the cache."""
    for chunk in chunks:
        yield from (chunk.part(slice(k, k + CHUNK)) for k in range(0, len(chunk.x), CHUNK))
