"""Straight lines fitted in a window around every Chebyshev node, from sums over the samples there: they stream."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.signal import Floats
from whid.stages._cells import Cells, first_line
from whid.stages._chebyshev import Domain, basis, unscaled

ROUNDING = 1e-9  # of a window's width: inputs closer together are one value
_NONE = np.zeros(0, bool)
WIDEST = 2.0  # half-widths: the whole domain from any node


class Line(NamedTuple):
    """A window and its line, o = t − node: a sample's weight in the value at the node is at_node[0] + at_node[1]·o."""

    node: float
    half_width: float
    points: int
    value: float  # of the line at the node
    rest: float  # Σ (y − line)²
    at_node: tuple[float, float]
    terms: Floats  # (K + 1,) Σ weight·T_k(t)
    inside: Floats  # the same over the samples of the domain only


class Seen(NamedTuple):
    """Which inputs there were, in units of half the domain: the outermost, and how many in all."""

    low: float
    high: float
    samples: int

    @classmethod
    def of(cls, t: Floats) -> Seen:
        """Return what of inputs that are all here."""
        return cls(float(t.min(initial=np.inf)), float(t.max(initial=-np.inf)), len(t))


def half_widths(inputs: Iterable[Floats], centres: Floats, halves: Floats, min_points: int) -> Floats:
    """Return the half-width of every window: doubled until it holds min_points samples; ∞ where the widest does not.

    inputs: t in chunks, no more of them than are needed; centres, halves (n,), all in units of half the domain.
    """
    steps = [1 + int(np.floor(np.log2(WIDEST / half))) for half in halves]
    counts = [np.zeros(n, np.intp) for n in steps]
    for t in inputs:
        for centre, half, count in zip(centres, halves, counts, strict=True):
            enough = int(np.argmax(count >= min_points)) if count.max() >= min_points else len(count)
            if enough:  # not yet settled by the narrowest
                away = np.abs(t - centre)
                for j in range(enough):
                    count[j] += np.count_nonzero(away <= half * 2**j)
        if all(count[0] >= min_points for count in counts):
            break
    found = [half * 2.0 ** np.argmax(c >= min_points) for half, c in zip(halves, counts, strict=True)]
    return np.where([c.max() >= min_points for c in counts], found, np.inf)


@dataclass
class Windows:
    """The windows of all nodes, with the sums over their samples.

    order  K where the sums of T₀ … T_K are wanted too, else −1

    The line of a window's first samples is taken off y before anything is squared.
    """

    centres: Floats
    halves: Floats
    order: int = -1
    near: Floats = field(init=False)  # (n, 2) a line near y, value at the node and slope
    sums: Floats = field(init=False)  # (n, 3, 3) of (1, o, y − that line), products of each two
    terms: Floats = field(init=False)  # (n, K + 1, 2) of T_k, o·T_k
    beyond: Floats = field(init=False)  # the same, outside the domain
    ends: Floats = field(init=False)  # (n, 2) smallest and largest o
    shared: dict[tuple[int, int], Floats] = field(init=False)  # of overlapping windows i, j: Σ 1, o, o² about node i

    def __post_init__(self) -> None:
        n = len(self.centres)
        self.sums, self.ends = np.zeros((n, 3, 3)), np.tile([np.inf, -np.inf], (n, 1))
        self.terms, self.beyond = np.zeros((2, n, self.order + 1, 2))
        self.near = np.zeros((n, 2))
        low, high = self.centres - self.halves, self.centres + self.halves
        pairs = combinations(range(n), 2)
        self.shared = {(i, j): np.zeros(3) for i, j in pairs if min(high[i], high[j]) >= max(low[i], low[j])}

    @property
    def cuts(self) -> Floats:
        """Return where the windows begin, and where what follows them does: both ends belong to a window."""
        return np.concatenate([self.centres - self.halves, np.nextafter(self.centres + self.halves, np.inf)])

    def collect(self, cells: Cells) -> None:
        """Take the sums of samples from cells that were cut at the windows' ends, and at the domain's."""
        low, high = self.cuts.reshape(2, -1)
        inside, terms = cells.between(-1.0, np.nextafter(1.0, 2.0)), cells.terms(self.order + 1)
        all_of = [cells.between(a, b) for a, b in zip(low, high, strict=True)]
        for i, (mine, centre) in enumerate(zip(all_of, self.centres, strict=True)):
            if not cells.sums[0, mine].any():
                continue
            self.near[i] = cells.line(mine[np.argmax(cells.sums[0, mine])], centre)
            self.sums[i] = cells.about(mine, centre, self.near[i])
            self.ends[i] = cells.ends[0, mine].min() - centre, cells.ends[1, mine].max() - centre
            if self.order >= 0:
                self.terms[i] = _about(terms[:, mine].sum(axis=1), centre, self.order)
                outer = np.setdiff1d(mine, inside)
                self.beyond[i] = _about(terms[:, outer].sum(axis=1), centre, self.order)
        for (i, j), shared in self.shared.items():
            both = cells.about(np.intersect1d(all_of[i], all_of[j]), self.centres[i], self.near[i])
            shared[:] = both[0, 0], both[0, 1], both[1, 1]

    def _take(self, places: Sequence[NDArray[np.intp]], t: Floats, y: Floats) -> None:
        """Take the samples of every window, their numbers known."""
        offsets = [t[where] - centre for where, centre in zip(places, self.centres, strict=True)]
        for i, (where, o) in enumerate(zip(places, offsets, strict=True)):
            if not len(o):
                continue
            self.near[i] = first_line(o, y[where])
            columns = np.ones((3, len(o)))
            columns[1], columns[2] = o, y[where] - self.near[i, 0] - self.near[i, 1] * o
            self.sums[i] += columns @ columns.T
            self.ends[i] = min(self.ends[i, 0], o.min()), max(self.ends[i, 1], o.max())
            if self.order >= 0:
                local = basis(t[where], self.order)
                self.terms[i] += local @ columns[:2].T
                out = np.abs(t[where]) > 1 if max(-self.ends[i, 0], self.ends[i, 1]) + abs(self.centres[i]) > 1 else _NONE
                if out.any():
                    self.beyond[i] += local[:, out] @ columns[:2, out].T
        for (i, j), shared in self.shared.items():
            o = offsets[i]
            both = o[np.abs(o + (self.centres[i] - self.centres[j])) <= self.halves[j]]
            shared += len(both), both.sum(), both @ both

    @classmethod
    def filled(cls, t: Floats, y: Floats, centres: Floats, halves: Floats, min_points: int, order: int = -1) -> Windows:
        """Return windows of samples that are all here, each half-width doubled until it holds min_points of them."""
        return next(cls.each_filled(t, [y], centres, halves, min_points, order))

    @classmethod
    def each_filled(
        cls, t: Floats, outputs: Iterable[Floats], centres: Floats, halves: Floats, min_points: int, order: int = -1
    ) -> Iterator[Windows]:
        """Yield the windows of every output over the same inputs."""
        places, found = [], np.array(halves)
        for i, centre in enumerate(centres):
            away = np.abs(t - centre)
            where = np.flatnonzero(away <= found[i])
            while len(where) < min_points and found[i] <= WIDEST:
                found[i] *= 2
                where = np.flatnonzero(away <= found[i])
            found[i] = found[i] if found[i] <= WIDEST else np.inf
            places.append(where)
        for y in outputs:
            windows = cls(centres, found, order)
            windows._take(places, t, y)
            yield windows

    def lines(self, domain: Domain, seen: Seen, min_points: int) -> list[Line]:
        """Return the line of every window.

        Raises `WhidError`: "stage-too-short" where the samples do not suffice, "stage-one-sided" where all lie on one side
        of the node, "stage-rank-one" where all are at one input.
        """
        if not np.isfinite(self.halves).all():
            message = f"{seen.samples} samples in the domain are too few for windows of {min_points}"
            raise WhidError("stage-too-short", message)
        return [self._line(i, _Place(i, float(self.centres[i]), domain, seen)) for i in range(len(self.centres))]

    def _line(self, i: int, place: _Place) -> Line:
        (n, first, z), (_, second, oz), (_, _, zz) = self.sums[i]
        low, high = self.ends[i]
        if high - low <= ROUNDING * self.halves[i]:
            said = f"all {n:.0f} samples of its window have one input, {place.inputs(low, high)}"
            raise WhidError("stage-rank-one", f"{place}: {said}; a line needs two")
        if low > 0 or high < 0:
            said = f"all {n:.0f} samples of its window lie on one side, at {place.inputs(low, high)}"
            raise WhidError("stage-one-sided", f"{place}: {said}; {place.covered}")
        determinant = n * second - first**2
        weight = (second / determinant, -first / determinant)
        value, slope = weight[0] * z + weight[1] * oz, (n * oz - first * z) / determinant
        terms = self.terms[i] @ weight
        return Line(
            float(self.centres[i]), float(self.halves[i]), int(n), float(self.near[i, 0] + value),
            max(0.0, float(zz - value * z - slope * oz)), weight, terms, terms - self.beyond[i] @ weight,
        )  # fmt: skip

    def overlap(self, found: Sequence[Line]) -> Floats:
        """Return A·Aᵀ of the weights at the nodes: covariance of the values for unit noise; windows may share samples."""
        result = np.diag([_product(line.at_node, line.at_node, s[0, 0], s[0, 1], s[1, 1])
                          for line, s in zip(found, self.sums, strict=True)])  # fmt: skip
        for (i, j), shared in self.shared.items():
            alpha, beta = found[j].at_node
            about_i = (alpha + beta * (found[i].node - found[j].node), beta)
            result[i, j] = result[j, i] = _product(found[i].at_node, about_i, *shared)
        return result


def _about(sums: Floats, centre: float, order: int) -> Floats:
    """Return Σ T_k and Σ o·T_k, (K + 1, 2), o from a centre, of Σ T_m, m ≤ K + 1: t·T_k = (T_{k+1} + T_{|k−1|})/2."""
    k = np.arange(order + 1)
    times = (sums[k + 1] + sums[np.abs(k - 1)]) / 2
    return np.stack([sums[k], times - centre * sums[k]], axis=1)


def _product(a: tuple[float, float], b: tuple[float, float], count: float, first: float, second: float) -> float:
    """Return Σ (a₀ + a₁ o)(b₀ + b₁ o)."""
    return float(a[0] * b[0] * count + (a[0] * b[1] + a[1] * b[0]) * first + a[1] * b[1] * second)


class _Place(NamedTuple):
    node: int
    centre: float
    domain: Domain
    seen: Seen

    def __str__(self) -> str:
        return f"node {self.node} at input {self._x(self.centre):.4g}"

    def _x(self, t: float) -> float:
        return float(unscaled(np.array(t), self.domain))

    @property
    def covered(self) -> str:
        low, high = self._x(max(-1.0, self.seen.low)), self._x(min(1.0, self.seen.high))
        return f"of the domain the data cover [{low:.4g}, {high:.4g}]: try that domain"

    def inputs(self, first: float, last: float) -> str:
        low, high = (self._x(self.centre + float(edge)) for edge in (first, last))
        return f"{low:.4g}" if high - low < 1e-6 * abs(high) else f"{low:.4g} … {high:.4g}"
