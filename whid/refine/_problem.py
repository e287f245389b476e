"""A whole-record fit as rows [∂ŷ/∂θ | ŷ − y], simulated chunk by chunk, whitened, weighted, ready to be reduced."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from whid.blocks._block import PERIODIC, STEADY, Block, State
from whid.blocks._stack import Bundle, stacked
from whid.blocks.linear import Linear
from whid.errors import WhidError
from whid.fit import Parameter, Triangle
from whid.predict import chunks, input_signal
from whid.record import CHUNK, Record
from whid.refine._free import FreeNumbers, walk
from whid.signal import Floats, Kept, Signal, joined
from whid.stages._whiten import whitened

Bools = NDArray[np.bool_]
FASTEST = 100.0  # of a pole, per sample: beyond, a block passes its input on, and the exact path gets slow
LEAST = 16384  # samples of a chunk of tangents: many tangents in short chunks stay in the cache, too
KEPT = 1 << 18  # samples of all records, at most, whose signals a trial keeps for its linearisation: some 300 B a sample
MOST_STATES = 8  # unknown levels of the past of one record, at most


@dataclass(frozen=True, eq=False)
class Data:
    """One record as the fit sees it.

    use    (N,) samples that count
    std    of the noise (of its innovation, where `ar` colours it); 1 while it is unknown
    weight (N,) factors of the residual, or None
    periods, scatter  the use samples are the mean of so many periods, which scatter about it by so much, Σ (y − ȳ)²
    returns  the samples up to the last that counts are one period, before which there were others like it
    past   lengths of the held levels that stand for an unknown past (`initial: free`), oldest first
    """

    record: Record
    use: Bools
    std: float = 1.0
    ar: Floats = field(default_factory=lambda: np.empty(0))
    weight: Floats | None = None
    past: tuple[int, ...] = ()
    periods: int = 1
    scatter: float = 0.0
    returns: bool = False

    @cached_property
    def _inputs(self) -> dict[tuple[str, int], Signal]:
        """Return the input with its course, which need not be made again for every model."""
        return {}

    @cached_property
    def _parts(self) -> dict[tuple[int, bool, int, int], Signal]:
        """Return its chunks."""
        return {}

    @cached_property
    def kept(self) -> Kept:
        """Return what a trial made of its input."""
        return Kept()

    @cached_property
    def last(self) -> int:
        """Return where the samples that count end: nothing behind needs simulating."""
        return int(np.flatnonzero(self.use)[-1]) + 1

    @classmethod
    def of(cls, record: Record, tree: Block) -> Data:
        """Return the estimation samples of a record."""
        use = record.using("estimation") & np.isfinite(record.y)
        return cls(record, use, past=_past(tree, record) if record.initial == "free" else ())

    def input(self, tree: Block, path: str, past: Floats) -> Signal:
        """Return the input, what stands for its past in front of it."""
        key = (path, tree.panel_order(self.record.dt))
        if key not in self._inputs:
            self._inputs[key] = input_signal(tree, self.record, path)
        return self.begun(self._inputs[key], past)

    def part(self, u: Signal, part: slice) -> Signal:
        """Return a chunk of the input, the same one every time, so that what was made of it is found in `kept`."""
        if self.past:
            return u[part]
        key = u.order, u.sampled, part.start, part.stop
        if key not in self._parts:
            self._parts[key] = replace(u[part], kept=self.kept)
        return self._parts[key]

    def begun(self, u: Signal, past: Floats) -> Signal:
        """Return an input with what stands for its past in front of it."""
        return u if not self.past else joined(self._before(u, np.repeat(past, self.past)), u)

    def seeds(self, u: Signal) -> list[Signal]:
        """Return the derivative of the input with respect to every level of its past."""
        borders = np.cumsum([0, *self.past])
        found = []
        for a, b in pairwise(borders):
            values = np.zeros(len(u.values))
            values[a:b] = 1.0
            found.append(Signal(values, u.dt, u.t0, "discrete" if u.sampled else "zoh", u.order))
        return found

    def start(self, tree: Block, u: Signal) -> State:
        """Return the state before the first sample: rest, periodic, or steady at the first value where there is one."""
        if self.returns:
            return PERIODIC
        if self.record.initial == "rest":
            return None
        try:
            tree.steady(float(u.values[0]), u.dt)
        except WhidError:
            if self.record.initial == "steady":
                raise
            return None
        return STEADY

    @property
    def samples(self) -> int:
        """Return how many measured samples count."""
        return int(self.use.sum()) * self.periods

    @property
    def lead(self) -> int:
        """Return the samples that stand before the record."""
        return sum(self.past)

    def _before(self, u: Signal, values: Floats) -> Signal:
        between = "discrete" if u.sampled else "zoh"
        return Signal(values, u.dt, u.t0 - u.dt * self.lead, between, u.order)  # type: ignore[arg-type]


def _past(tree: Block, record: Record) -> tuple[int, ...]:
    """Return lengths, in samples, of as many past levels as the linear blocks have states; they double backwards in time.

    A state that was reached was reached by some input: its levels are numbers that keep their meaning while the model
    changes, which coordinates of a state do not.
    """
    states = min(sum(len(p) for p, _ in _poles(tree)), MOST_STATES)
    samples = memory(tree, record.dt, len(record))
    shares = 2.0 ** np.arange(states)[::-1]
    return tuple(int(max(1, np.ceil(samples * share / shares.sum()))) for share in shares)


def memory(tree: Block, dt: float, most: int) -> float:
    """Return three time constants of the slowest linear block, in samples, `most` at most."""
    rates = [np.abs(np.log(np.abs(p) + 1e-300)) if discrete else np.abs(p.real) * dt for p, discrete in _poles(tree)]
    slow = np.concatenate([r for r in rates if len(r)] or [np.ones(1)])
    return 3.0 / max(float(slow[slow > 0].min(initial=np.inf)), 3.0 / max(most, 3))


def _poles(tree: Block) -> list[tuple[NDArray[np.complex128], bool]]:
    return [(b.eigenvalues(), b.dt is not None) for _, b in walk(tree) if isinstance(b, Linear)]


def fastest(tree: Block, dt: float) -> float:
    """Return the largest |pole|·dt of the continuous linear blocks."""
    return max([0.0, *(float(np.abs(p).max(initial=0.0)) * dt for p, discrete in _poles(tree) if not discrete)])


@dataclass(frozen=True, eq=False)
class Problem:
    """Σ over records and samples of (ŷ − y)², in units of the noise.

    With derivatives on another path than the response's the steps are those of a near model, and the fit ends where they
    find nothing more to gain: as much off as those derivatives are, in standard errors.
    """

    free: FreeNumbers
    data: tuple[Data, ...]
    path: str = "exact"
    rates: str = ""  # path of the derivatives; that of the response, where it is not named

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return θ: the tree's free numbers, then the levels of every unknown past."""
        past = [
            Parameter(f"{d.record.name}.past.{k}", float(d.record.u[0]), "input")
            for d in self.data
            for k in range(len(d.past))
        ]
        return (*self.free.parameters, *past)

    @property
    def start(self) -> Floats:
        """Return θ at its start values."""
        return np.array([p.value for p in self.parameters])

    def cost(self, theta: Floats) -> float:
        """Return χ², infinite where the model cannot be simulated, or not in any reasonable time."""
        try:
            tree = self.free.at(theta[: len(self.free.parameters)])
            if any(fastest(tree, d.record.dt) > FASTEST for d in self.data):
                return float("inf")
            for d in self.data:
                d.kept.clear(open=sum(len(each.record) for each in self.data) <= KEPT)
            rows = self._rows(theta, tangents=False)
            return self._scatter + sum(float(part[:, 0] @ part[:, 0]) for part in rows)
        except (WhidError, ValueError, np.linalg.LinAlgError):
            return float("inf")

    def linearise(self, theta: Floats) -> Triangle:
        """Return χ² to second order about θ, by the tangents of the simulation."""
        key = theta.tobytes()
        if key not in self.latest:
            self.latest.clear()
            for d in self.data:
                d.kept.open = False  # a trial's signals serve; those of tangents are not worth their memory
            found = Triangle.stacked(self._rows(theta, tangents=True))
            for d in self.data:
                d.kept.clear()
            count = sum(d.samples for d in self.data)
            self.latest[key] = found._replace(rest=found.rest + self._scatter, samples=count)
        return self.latest[key]

    @cached_property
    def latest(self) -> dict[bytes, Triangle]:
        """Return the last linearisation, by θ."""
        return {}

    @property
    def rounding(self) -> float:
        """Return the χ² that rounding leaves."""
        return sum(float(np.sum((1e-14 * d.record.y[d.use] / d.std) ** 2)) * d.periods for d in self.data)

    @property
    def _scatter(self) -> float:
        return sum(d.scatter / d.std**2 for d in self.data)

    def residuals(self, theta: Floats) -> list[Floats]:
        """Return ŷ − y of every record, in its own unit, NaN where a sample does not count."""
        raw = replace(self, data=tuple(replace(d, std=1.0, ar=np.empty(0), weight=None, periods=1) for d in self.data))
        found = [np.full(len(d.use), np.nan) for d in self.data]
        for record, d, rows in zip(found, raw.data, raw._by_record(theta, tangents=False), strict=True):
            record[d.use] = np.concatenate([part[:, 0] for part in rows])
        return found

    def _rows(self, theta: Floats, *, tangents: bool) -> Iterator[Floats]:
        for rows in self._by_record(theta, tangents=tangents):
            yield from rows

    def _by_record(self, theta: Floats, *, tangents: bool) -> Iterator[Iterator[Floats]]:
        own = len(self.free.parameters)
        tree, change = self.free.at(theta[:own]), self.free.expanded(theta[:own])[1]
        first = own
        for d in self.data:
            levels = slice(first, first + len(d.past))
            first = levels.stop
            yield _weighted(d, self._simulated(d, tree, theta[levels], change, levels if tangents else None, len(theta)))

    def _simulated(
        self, d: Data, tree: Block, past: Floats, change: Floats, levels: slice | None, size: int
    ) -> Iterator[Floats]:
        """Yield rows [∂ŷ/∂θ | ŷ − y], or [ŷ − y] alone where `levels` is None, in time order."""
        u = d.input(tree, self.path, past)
        u = u if tree.looks_ahead() else u[: d.lead + d.last]
        near = u if self.rates in ("", self.path) else d.input(tree, self.rates, past)[: u.samples]
        state, seeds = d.start(tree, u), stacked(d.seeds(near)) if levels and d.lead else None
        along_state = state
        own = len(self.free.parameters)
        for part in chunks(u.samples, tree, max(CHUNK // max(size, 1), LEAST)):
            keep = max(d.lead - part.start, 0)
            rows = np.empty((1 if levels is None else size + 1, max(part.stop - part.start - keep, 0)))
            if levels is None:
                out, state = tree.step(d.part(u, part), state)
            else:
                before = [] if seeds is None else Bundle(seeds[part])
                out, tangents, along_state = tree.tangent(d.part(near, part), before, self.free.names, along_state)
                if near is not u:
                    out, state = tree.step(d.part(u, part), state)
                along = stacked(tangents).values[:, keep:] if len(tangents) else np.empty((0, rows.shape[1]))
                rows[own:-1] = 0.0  # the levels of other records
                rows[:own] = along[len(before) :] if self.free.plain else change.T @ along[len(before) :]
                rows[levels] = along[: len(before)]
            at = slice(part.start + keep - d.lead, part.stop - d.lead)
            if rows.shape[1]:
                rows[-1] = out.values[keep:] - np.where(d.use[at], d.record.y[at], 0.0)
                yield rows.T


def _weighted(d: Data, chunked: Iterator[Floats]) -> Iterator[Floats]:
    """Yield the rows that count, whitened across chunks, over the noise's standard deviation."""
    p, start, scale = len(d.ar), 0, np.sqrt(d.periods) / d.std
    before, known = np.empty((0, 0)), np.empty(0, bool)
    for rows in chunked:
        here = slice(start, start + len(rows))
        use, start = d.use[here], here.stop
        white = rows
        if p:
            joint = np.vstack([before, rows]) if before.size else rows
            valid = np.append(known, use)
            white = whitened(joint, valid, d.ar)[len(known) :]
            before, known = joint[-p:], valid[-p:]
        if d.weight is not None:
            white = white * d.weight[here, None]
        white = white if use.all() else white.T[:, use].T
        yield white if scale == 1 else scale * white


def data_of(records: Sequence[Record], tree: Block, std: Sequence[float] | None = None) -> tuple[Data, ...]:
    """Return what a fit sees of records; raise `WhidError("fit-no-data")` where nothing is for estimation."""
    found = tuple(Data.of(record, tree) for record in records)
    if std is not None:
        found = tuple(replace(d, std=float(s)) for d, s in zip(found, std, strict=True))
    found = tuple(d for d in found if d.use.any())
    if not found:
        raise WhidError("fit-no-data", "no record has samples for estimation")
    for d in found:
        gone = ~np.isfinite(d.record.u[: d.last])
        if gone.any():
            where = f"record {d.record.name!r}, sample {int(np.flatnonzero(gone)[0])}"
            raise WhidError("fit-start", f"the input is no number at {int(gone.sum())} samples", where)
    return found
