"""All that the stages of a curve without memory need of the samples: sums, made in one pass over chunks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from whid.fit import normal_equations
from whid.signal import Floats
from whid.stages._chebyshev import CHUNK, Domain, Moments, basis, moments, scaled
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
    square: float  # Σ y²
    crossed: Floats  # (K + 1, L) Σ T_k·earlier
    lags: Floats  # (L, L) Σ earlier·earlier
    lag_products: Floats  # (L,) Σ earlier·r
    seen: Seen  # outside the domain as well

    @property
    def order(self) -> int:
        """Return K."""
        return len(self.pilot) - 1


def one_chunk(x: Floats, y: Floats, earlier: Floats | None = None) -> list[Samples]:
    """Return arrays as the only chunk there is."""
    return [Samples(x, y, np.empty((0, len(x))) if earlier is None else earlier)]


def curve_sums(
    chunks: Iterable[Samples], order: int, domain: Domain, extra: int | None = None, windows: Sequence[Windows] = ()
) -> CurveSums:
    """Return the sums of all chunks in one pass, and fill the windows on the way.

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
    known = _moments(head, wide, domain)  # of y: of what the pilot leaves over come the products only
    pilot = normal_equations(known.gram(order), known.products[: order + 1], known.square, known.samples).values
    left = Moments(known.sums, np.zeros(wide + 1), 0.0, known.samples)
    lags = len(head[0].earlier) if head else 0
    crossed, inner, lagged = np.zeros((order + 1, lags)), np.zeros((lags, lags)), np.zeros(lags)
    square, low, high, samples = 0.0, np.inf, -np.inf, 0
    for chunks_of, more in ((head, False), (rest, True)):
        for x, y, earlier in _small(chunks_of):
            t = scaled(x, domain)
            order_of = np.argsort(t)  # windows and the domain are then stretches, which no sample need be picked out for
            t, y = t[order_of], y[order_of]
            low, high, samples = min(low, float(t[0])), max(high, float(t[-1])), samples + len(t)
            rows = basis(t, wide)
            for each in windows:
                each.add(t, y, rows)
            inside = slice(int(np.searchsorted(t, -1.0)), int(np.searchsorted(t, 1.0, side="right")))
            t, y, rows = t[inside], y[inside], rows[:, inside]
            r = y - pilot @ rows[: order + 1]
            left = left.joined(moments(t, r, wide, rows) if more else Moments(np.zeros(1), rows @ r, float(r @ r), 0))
            square += float(y @ y)
            if lags:
                before = scaled(np.stack([row[order_of[inside]] for row in earlier]), domain)
                crossed += rows[: order + 1] @ before.T
                inner += before @ before.T
                lagged += before @ r
    return CurveSums(domain, pilot, left, square, crossed, inner, lagged, Seen(low, high, samples))


def _head(chunks: Iterator[Samples]) -> tuple[list[Samples], Iterator[Samples]]:
    """Return the first HEAD samples, and what follows them."""
    head: list[Samples] = []
    missing = HEAD
    for chunk in chunks:
        head.append(chunk.part(slice(0, missing)))
        if len(chunk.x) > missing:
            return head, _after(chunk.part(slice(missing, None)), chunks)
        missing -= len(chunk.x)
    return head, chunks


def _after(first: Samples, chunks: Iterator[Samples]) -> Iterator[Samples]:
    yield first
    yield from chunks


def _small(chunks: Iterable[Samples]) -> Iterator[Samples]:
    """Yield samples in chunks whose basis stays in the cache."""
    for chunk in chunks:
        yield from (chunk.part(slice(k, k + CHUNK)) for k in range(0, len(chunk.x), CHUNK))


def _moments(chunks: Iterable[Samples], order: int, domain: Domain) -> Moments:
    found = Moments(np.zeros(2 * order + 1), np.zeros(order + 1), 0.0, 0)
    for x, y, _ in _small(chunks):
        t = scaled(x, domain)
        inside = np.abs(t) <= 1
        found = found.joined(moments(t, y, order) if inside.all() else moments(t[inside], y[inside], order))
    return found
