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
            m.square - float(change @ (2 * m.products[:size] - m.gram(self.order) @ change))
            for m in (self.left, self.beyond)
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
    """The sums under way.

    The rows of a chunk are in one place, in an order that makes every sum one of few products: room for the cells' five;
    T₀ … T_n, r; r·T_n, T₂ₙ, T₃ₙ, which stand for the terms beyond n, as T_{an+i} = 2 T_{an} T_i − T_{an−i}; earlier inputs.
    """

    def __init__(self, domain: Domain, wide: int, pilot: Floats, windows: Sequence[Windows], lags: int) -> None:
        self.domain, self.wide, self.pilot, self.sorts = domain, wide, pilot, bool(windows)
        edges = np.array([-1.0, np.nextafter(1.0, 2.0)])
        n = self.n = max(len(pilot), (wide + 1) // 2)
        self.cells = Cells(np.concatenate([edges, *(each.cuts for each in windows)]), n)
        self.domain_cells = self.cells.between(*edges)
        self.rows = np.empty((n + 10 + lags, CHUNK))
        self.low, self.products, self.inner = np.zeros(n + 1), np.zeros((n + 2, 5 + lags)), np.zeros((lags, lags))
        self.seen = Seen(np.inf, -np.inf, 0)
        self.beyond, self.outside = empty(len(pilot) - 1), [np.empty((2, 0))]

    def add(self, x: Floats, y: Floats, earlier: Floats) -> None:
        """Add a chunk of samples."""
        if not len(x):
            return
        t, n = scaled(x, self.domain), self.n
        low, high = float(t.min()), float(t.max())
        self.seen = Seen(min(low, self.seen.low), max(high, self.seen.high), self.seen.samples + len(t))
        order, inside = None, slice(0, len(t))
        if self.sorts or low < -1 or high > 1:
            grouped = self.cells.group(t)
            order = grouped.order
            t, y = t[order], y[order]
            inside = slice(grouped.until(self.domain_cells[0]), grouped.until(self.domain_cells[-1] + 1))
        rows = self.rows[:, : len(t)]
        terms, (r, by_r, double, triple), before = rows[5 : 6 + n], rows[6 + n : 10 + n], rows[10 + n :]
        basis(t, n, terms)
        if self.sorts:
            self.cells.add(grouped, t, y, rows[: 6 + n])
        np.subtract(y, self.pilot @ terms[: len(self.pilot)], out=r)
        np.multiply(r, terms[n], out=by_r)
        twice = terms[n] + terms[n]
        np.multiply(twice, terms[n], out=double)
        double -= 1
        np.multiply(twice, double, out=triple)
        triple -= terms[n]
        for row, into in zip(earlier, before, strict=True):
            if order is None:
                into[:] = row
            else:
                np.take(row, order, out=into, mode="clip")
        if self.domain != (-1.0, 1.0):
            before[:] = scaled(before, self.domain)
        self._sum(rows[:, inside])
        for part in (slice(0, inside.start), slice(inside.stop, len(t))):
            if part.start < part.stop:
                self.outside.append(np.stack([t[part], r[part]]))
        if sum(each.shape[1] for each in self.outside) > CHUNK:
            self._gathered()

    def _sum(self, rows: Floats) -> None:
        """Add the rows of samples in the domain."""
        n = self.n
        self.low += rows[5 : 6 + n] @ rows[5]
        self.products += rows[5 : 7 + n] @ rows[5 + n :].T
        if len(self.inner):
            before = rows[10 + n :]
            self.inner += before @ before.T

    def _gathered(self) -> None:
        """Add the samples outside the domain, a few of every chunk, when they are many."""
        t, r = np.hstack(self.outside)
        self.beyond, self.outside = self.beyond.joined(moments(t, r, len(self.pilot) - 1)), [np.empty((2, 0))]

    def found(self) -> CurveSums:
        """Return what was summed."""
        self._gathered()
        n, size, products = self.n, len(self.pilot), self.products
        sums, of_r = np.zeros(4 * n + 1), np.zeros(2 * n + 1)
        sums[: n + 1], of_r[: n + 1] = self.low, products[: n + 1, 1]
        for a, column in ((1, 0), (2, 3), (3, 4)):
            sums[a * n : (a + 1) * n + 1] = 2 * products[: n + 1, column] - sums[(a - 1) * n : a * n + 1][::-1]
        of_r[n:] = 2 * products[: n + 1, 2] - of_r[: n + 1][::-1]
        square = float(products[n + 1, 1])
        left = Moments(sums[: 2 * self.wide + 1], of_r[: self.wide + 1], square, round(self.low[0]))
        outputs = square + float(self.pilot @ (2 * of_r[:size] + left.gram(size - 1) @ self.pilot))
        return CurveSums(
            self.domain,
            self.pilot,
            left,
            self.beyond,
            outputs,
            products[:size, 5:],
            self.inner,
            products[n + 1, 5:],
            self.seen,
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
