"""All that the stages of a curve without memory need of the samples: sums, made in one pass over chunks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from whid.fit import normal_equations
from whid.signal import Floats, Spread
from whid.stages._cells import ROOM, Cells
from whid.stages._chebyshev import CHUNK, Domain, Moments, basis, empty, moments, scaled
from whid.stages._local_lines import Seen, Windows

HEAD, PILOT = 1 << 16, 1 << 13  # samples that the pilot is from, and about how many of them: it need only be near
TESTED, EVERY = 1 << 20, 32  # whether there is memory is asked of so many samples, and of every so many-th chunk
NOWHERE = np.empty(0, np.intp)
EDGES = np.array([-1.0, np.nextafter(1.0, 2.0)])  # of the domain, both of which belong to it


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
    tested: Moments  # of r over those that earlier inputs are tested on: all of a million, every 32nd chunk from there on
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

    @property
    def outputs(self) -> Spread:
        """Return the spread of y of all samples; what is squared has no offset."""
        offset, course, size = float(self.pilot[0]), np.array([0.0, *self.pilot[1:]]), self.order + 1
        total = Spread()
        for m in (self.left, self.beyond):
            if m.samples:
                mean = float(m.products[0] + course @ m.sums[:size]) / m.samples
                square = m.square + float(course @ (2 * m.products[:size] + m.gram(self.order) @ course))
                total = total.joined(Spread(m.samples, offset + mean, max(0.0, square - m.samples * mean**2)))
        return total


def one_chunk(x: Floats, y: Floats, earlier: Floats | None = None) -> list[Samples]:
    """Return arrays as the only chunk there is."""
    return [Samples(x, y, np.empty((0, len(x))) if earlier is None else earlier)]


def curve_sums(
    chunks: Iterable[Samples], order: int, domain: Domain, extra: int | None = None, windows: Sequence[Windows] = ()
) -> CurveSums:
    """Return the sums of all chunks in one pass, and those of the windows.

    The pilot is least squares of every few of the first 65 536 samples. extra: terms beyond K (left out: K + 1). Where the
    chunks are cut does not matter but for rounding.

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
    if work.cells is not None:
        for each in windows:
            each.collect(work.cells)
    return work.found()


class _Work:
    """The sums under way: with windows in cells, without in rows; and in rows what earlier inputs are tested on."""

    def __init__(self, domain: Domain, wide: int, pilot: Floats, windows: Sequence[Windows], lags: int) -> None:
        self.domain, self.wide, self.pilot = domain, wide, pilot
        self.rows = _Rows(domain, wide, pilot, lags)
        self.cells, self.room = None, np.empty((ROOM, CHUNK if windows else 0))
        if windows:
            self.cells = Cells(np.concatenate([EDGES, *(each.cuts for each in windows)]), wide, pilot)
            inside = self.cells.between(*EDGES)
            self.domain_cells = int(inside[0]), int(inside[-1]) + 1
        self.seen, self.chunks = Seen(np.inf, -np.inf, 0), 0
        self.beyond, self.outside = empty(len(pilot) - 1), [np.empty((2, 0))]

    def add(self, x: Floats, y: Floats, earlier: Floats) -> None:
        """Add a chunk of samples."""
        if not len(x):
            return
        t, before = scaled(x, self.domain), self.seen.samples
        if self.cells is None:
            low, high = float(t.min()), float(t.max())
            out = np.flatnonzero(np.abs(t) > 1) if low < -1 or high > 1 else NOWHERE
        else:
            grouped = self.cells.group(t)
            low, high = self.cells.add(grouped, t, y, self.room[:, : len(t)])
            first, stop = (grouped.until(k) for k in self.domain_cells)
            out = np.concatenate([grouped.order[:first], grouped.order[stop:]])
        self.seen = Seen(min(low, self.seen.low), max(high, self.seen.high), before + len(t))
        self.chunks += 1
        if self.cells is None or (len(earlier) and (before < TESTED or self.chunks % EVERY == 0)):
            if len(out):
                inside = np.abs(t) <= 1
                self.rows.add(t[inside], y[inside], earlier[:, inside])
            else:
                self.rows.add(t, y, earlier)
        if len(out):
            self.outside.append(np.stack([t[out], y[out]]))
        if sum(each.shape[1] for each in self.outside) > CHUNK:
            self._gathered()

    def _gathered(self) -> None:
        """Add the samples outside the domain, a few of every chunk, when they are many."""
        t, y = np.hstack(self.outside)
        order = len(self.pilot) - 1
        rows = basis(t, order)
        self.beyond = self.beyond.joined(moments(t, y - self.pilot @ rows, order, rows))
        self.outside = [np.empty((2, 0))]

    def found(self) -> CurveSums:
        """Return what was summed."""
        self._gathered()
        tested = left = self.rows.moments()
        inside = self.seen.samples - self.beyond.samples
        if tested.samples < inside and self.cells is not None:
            left = self.cells.moments(self.cells.between(*EDGES), self.wide)
        size, rows = len(self.pilot), self.rows
        outputs = left.square + float(self.pilot @ (2 * left.products[:size] + left.gram(size - 1) @ self.pilot))
        crossed, lagged = rows.products[:size, 5:], rows.products[-1, 5:]
        return CurveSums(
            self.domain, self.pilot, left, self.beyond, max(0.0, outputs), tested, crossed, rows.inner, lagged, self.seen
        )


class _Rows:
    """Sums of samples in the domain from their Chebyshev terms.

    The rows of a chunk are in one place, in an order that makes every sum one of few products: T₀ … T_n, r; r·T_n, T₂ₙ, T₃ₙ,
    which stand for the terms beyond n, as T_{an+i} = 2 T_{an} T_i − T_{an−i}; earlier inputs.
    """

    def __init__(self, domain: Domain, wide: int, pilot: Floats, lags: int) -> None:
        self.domain, self.wide, self.pilot = domain, wide, pilot
        n = self.n = max(len(pilot), (wide + 1) // 2)
        self.rows = np.empty((n + 5 + lags, CHUNK))
        self.low, self.products, self.inner = np.zeros(n + 1), np.zeros((n + 2, 5 + lags)), np.zeros((lags, lags))

    def add(self, t: Floats, y: Floats, earlier: Floats) -> None:
        """Add samples t, y (N,)."""
        n, rows = self.n, self.rows[:, : len(t)]
        terms, (r, by_r, double, triple), before = rows[: n + 1], rows[n + 1 : n + 5], rows[n + 5 :]
        basis(t, n, terms)
        np.subtract(y, self.pilot @ terms[: len(self.pilot)], out=r)
        np.multiply(r, terms[n], out=by_r)
        twice = terms[n] + terms[n]
        np.multiply(twice, terms[n], out=double)
        double -= 1
        np.multiply(twice, double, out=triple)
        triple -= terms[n]
        before[:] = scaled(earlier, self.domain)
        self.low += terms @ terms[0]
        self.products += rows[: n + 2] @ rows[n:].T
        self.inner += before @ before.T

    def moments(self) -> Moments:
        """Return what was summed."""
        n, products = self.n, self.products
        sums, of_r = np.zeros(4 * n + 1), np.zeros(2 * n + 1)
        sums[: n + 1], of_r[: n + 1] = self.low, products[: n + 1, 1]
        for a, column in ((1, 0), (2, 3), (3, 4)):
            sums[a * n : (a + 1) * n + 1] = 2 * products[: n + 1, column] - sums[(a - 1) * n : a * n + 1][::-1]
        of_r[n:] = 2 * products[: n + 1, 2] - of_r[: n + 1][::-1]
        return Moments(sums[: 2 * self.wide + 1], of_r[: self.wide + 1], float(products[n + 1, 1]), round(self.low[0]))


def _pilot(head: Sequence[Samples], order: int, domain: Domain) -> Floats:
    """Return the least-squares coefficients of some of the first samples."""
    known, step = empty(order), max(1, sum(len(chunk.x) for chunk in head) // PILOT)
    for x, y, _ in head:
        t, y = scaled(x[::step], domain), y[::step]
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
