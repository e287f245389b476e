"""From a data file too long for memory to a LongRecord: the steps of `ingest`, chunk by chunk."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.files import checks, grid
from whid.files.ingest import Chosen, choose, opened, placed, seconds, step_in
from whid.files.source import DataSource, locate
from whid.files.table import Table
from whid.kinds import plain
from whid.long_record import LongRecord
from whid.operations._operation import Series
from whid.record import Chunk
from whid.signal import Floats, Ints

FIRST = 1000  # rows that the sampling time is read from
LOOKED_AT = 200_000  # samples that are looked at for swapped columns


class IngestedLong(NamedTuple):
    """A record to be read in chunks, what was noticed on the way, and which file it is."""

    record: LongRecord
    notes: tuple[str, ...]
    sha256: str


def ingest_long(source: DataSource, base: Path) -> IngestedLong:
    """Return the record of a data source, whose file is read through once now, and again whenever somebody reads the record.

    The same numbers as `ingest` gives, but for the last digits of dt, which comes from the first and the last time. Columns
    are looked at for being swapped on the first 200 000 samples only. Raises `WhidError` with a code `data-…`, the file and,
    where there is one, the row; `WhidError("memory")` for what acts on whole columns: an operation, `parts: auto`.
    """
    path, table = locate(source.file, base), opened(source, base)
    try:
        record, notes = _record(source, table)
    except WhidError as fault:
        raise fault if fault.where else WhidError(fault.code, fault.message, path.name) from fault
    with path.open("rb") as file:
        return IngestedLong(record, notes, hashlib.file_digest(file, "sha256").hexdigest())


def whole(source: DataSource) -> str:
    """Return why the columns of a source must be in memory whole, "" where they may come in chunks."""
    if source.parts == "auto":
        return "parts: auto looks at the whole input; declare them: `whid ingest` finds them in a shorter file"
    for operation in source.operations:
        if not operation.pointwise:
            return f"operation {operation.kind} acts on whole columns: apply it before"
    return ""


def _record(source: DataSource, table: Table) -> tuple[LongRecord, tuple[str, ...]]:
    if table.blocks is None or whole(source):
        raise WhidError("memory", whole(source) or "a file of this kind is not read in chunks: save it as HDF5 or CSV")
    chosen, notes = choose(source, table)
    pass_ = _Pass(source, table, chosen)
    seen = _Seen(source, table)
    for chunk in pass_.chunks():
        seen.add(chunk)
    checks.check_length(pass_.samples, table.where(0).partition(":")[0])
    least = 1e-6 + 2 * np.spacing(abs(pass_.t0)) / max(pass_.dt, 1e-300)  # what the digits of the time explain
    jitter = (f"time jitter of {100 * pass_.jitter:.2g} % of a step accepted",) if pass_.jitter > least else ()
    counts = " and ".join(f"{n} {what}" for n, what in zip(pass_.gone, ("inputs", "outputs"), strict=True) if n)
    done = "outputs masked" if source.missing == "mask" else "interpolated"
    missing = (f"{counts} of {pass_.samples} missing: {done}",) if counts else ()
    more = (*pass_.notes, *jitter, *missing, *seen.notes())
    operated = [
        " ".join([f"operation {o.kind}:", ", ".join(f"{k} {v}" for k, v in plain(o).items() if k != "kind")])
        for o in source.operations
    ]
    dt = pass_.step()
    units = {
        "input": source.units.get("input") or table.units.get(table.names[chosen.input], "1"),
        "output": source.units.get("output") or table.units.get(table.names[chosen.output], "1"),
    }
    record = LongRecord(
        samples=pass_.samples, read=lambda outputs: _Pass(source, table, chosen).chunks(), dt=dt, t0=pass_.t0, units=units,
        intersample=source.intersample, initial=source.initial or "steady", parts=placed(source, dt, pass_.samples),
        name=source.name, use=source.use,
    )  # fmt: skip
    return record, (*notes, *more, *operated, f"{pass_.samples} samples, read in chunks")


@dataclass
class _Pass:
    """One reading of a file: what is known of its times so far, and samples that wait for what follows."""

    source: DataSource
    table: Table
    chosen: Chosen
    notes: tuple[str, ...] = ()
    t0: float = 0.0
    samples: int = 0  # on the grid
    rows: int = 0
    dt: float = 0.0  # the median of the first chunk's steps, then what is declared or read
    last: float = 0.0  # time
    timed: bool = False
    jitter: float = 0.0  # largest deviation of a step, in steps
    gone: tuple[int, int] = (0, 0)  # inputs and outputs that were missing

    def chunks(self) -> Iterator[Chunk]:
        """Yield the samples on a uniform grid, filled or NaN where they were missing, in the record's units."""
        assert self.table.blocks is not None
        source, waiting, start = self.source, _Waiting.none(), 0
        columns = [k for k in (self.chosen.input, self.chosen.output, self.chosen.time) if k is not None]
        for u, y, *time in _started(self.table.blocks(columns)):
            waiting = waiting.joined(self._on_grid(u, y, time[0] if time else None))
            ready, waiting = waiting.parted(source.missing == "interpolate")
            if len(ready.u):
                yield (chunk := self._complete(ready, start))
                start += len(chunk.u)
        if len(waiting.u) > waiting.context:
            yield self._complete(waiting, start)

    def step(self) -> float:
        """Return the sampling time of all the file, once it has been read."""
        if not self.timed:
            return self.dt
        return grid.tidy((self.last - self.t0) / max(self.samples - 1, 1), self.samples - 1, self.last)

    def _on_grid(self, u: Floats, y: Floats, time: Floats | None) -> _Waiting:
        """Return the next rows on the grid, NaN where rows were left out."""
        rows = np.arange(self.rows, self.rows + len(u))
        steps = np.ones(len(u), np.intp) if time is None else self._steps(time, rows)
        places = np.cumsum(steps) - 1
        self.rows, self.samples = self.rows + len(u), self.samples + int(steps.sum())
        if time is None and not self.dt:
            declared = self._declared()
            self.dt, self.notes = (declared, ()) if declared else step_in(self.table)
        if not len(u) or places[-1] == len(u) - 1:
            return _Waiting(u, y, rows, 0)
        on_grid = int(places[-1]) + 1
        full = np.full((2, on_grid), np.nan)
        full[:, places] = u, y
        before = np.searchsorted(places, np.arange(on_grid), side="right")  # rows up to here: a hole is at the row before it
        return _Waiting(full[0], full[1], np.append(rows[0] - 1, rows)[before], 0)

    def _declared(self) -> float | None:
        return self.source.dt or (1 / self.source.rate_hz if self.source.rate_hz else None)

    def _steps(self, time: Floats, rows: Ints) -> Ints:
        """Return by how many steps of the grid every row is after the one before; check the times."""

        def where(sample: int) -> str:
            return self.table.where(int(rows[0]) + sample - first)

        time, notes = seconds(self.source, self.table, self.chosen, time, self._declared())
        first = 0 if not self.timed else 1  # the last row of the chunk before stands in front
        extended = np.append(self.last, time) if self.timed else time
        grid.check_order(extended, where)
        steps = np.diff(extended)
        if not self.timed:
            self.timed, self.t0, self.notes = True, float(time[0]), notes
            if len(steps):
                self.dt = float(np.median(steps))
                if declared := self._declared():
                    grid.check_step(self.dt, declared, where)
        self.last = float(time[-1])
        whole = np.where(steps > grid.GAP * self.dt, np.rint(steps / self.dt), 1.0)
        deviation = np.abs(steps / self.dt - whole)
        if len(deviation) and deviation.max() > grid.JITTER:
            k = int(np.argmax(deviation > grid.JITTER))
            said = f"the step to this row is {steps[k]:.6g} s, the others {self.dt:.6g} s"
            raise WhidError("data-time-step", f"{said} (jitter {100 * deviation.max():.3g} %)", where(k + 1))
        self.jitter = max(self.jitter, float(deviation.max(initial=0.0)))
        return np.append(np.ones(1 - first, np.intp), whole.astype(np.intp))

    def _complete(self, ready: _Waiting, start: int) -> Chunk:
        source, masked = self.source, self.source.missing == "mask"
        known = np.isfinite(ready.y)
        y = np.where(known, ready.y, 0.0) if masked else ready.y

        def where(sample: int) -> str:
            return self.table.where(int(ready.rows[sample]))

        time: Floats = self.dt * np.arange(len(y), dtype=float)
        series, _ = grid.complete(time, ready.u, y, source.missing, source.intersample == "zoh", where)
        series = series._replace(valid=known if masked else series.valid)
        for operation in source.operations:
            series = operation.apply(series, self.table.scalars)
        for column, x in (("input", series.input), ("output", series.output[series.valid])):
            if len(x) and not float(np.abs(x).max()) <= checks.HUGE:
                checks.check_alive(x, column, where)
        after = slice(ready.context, None)
        gone = tuple(int(np.sum(~np.isfinite(x[after]))) for x in (ready.u, ready.y))
        self.gone = self.gone[0] + gone[0], self.gone[1] + gone[1]
        return Chunk(start, series.input[after], np.where(series.valid, series.output, np.nan)[after])


def _started(blocks: Iterator[list[Floats]]) -> Iterator[list[Floats]]:
    """Yield blocks of columns, the first long enough for the median of its steps."""
    first: list[list[Floats]] = []
    for block in blocks:
        first.append(block)
        if sum(len(each[0]) for each in first) >= FIRST:
            break
    if first:
        yield [np.concatenate(column) for column in zip(*first, strict=True)]
    yield from blocks


@dataclass
class _Waiting:
    """Samples on the grid as they were read, and their rows; the first `context` are known already, for joining lines."""

    u: Floats
    y: Floats
    rows: Ints
    context: int

    @classmethod
    def none(cls) -> _Waiting:
        """Return nothing."""
        return cls(np.empty(0), np.empty(0), np.empty(0, np.intp), 0)

    def joined(self, more: _Waiting) -> _Waiting:
        """Return these and what follows."""
        if not len(self.u):
            return more
        u, y = np.concatenate([self.u, more.u]), np.concatenate([self.y, more.y])
        return _Waiting(u, y, np.concatenate([self.rows, more.rows]), self.context)

    def parted(self, interpolate: bool) -> tuple[_Waiting, _Waiting]:
        """Return what can be completed, and what waits for a known sample behind a hole, with the last one known before."""
        known = np.isfinite(self.u) & (np.isfinite(self.y) if interpolate else True)
        at = np.flatnonzero(known[self.context :])
        if not len(at):
            return _Waiting.none(), self
        last = self.context + int(at[-1])
        ready = _Waiting(self.u[: last + 1], self.y[: last + 1], self.rows[: last + 1], self.context)
        return ready, _Waiting(self.u[last:].copy(), self.y[last:].copy(), self.rows[last:].copy(), 1)


@dataclass
class _Seen:
    """What a pass over a file found in its columns."""

    source: DataSource
    table: Table
    low: Floats = field(default_factory=lambda: np.full(2, np.inf))
    high: Floats = field(default_factory=lambda: np.full(2, -np.inf))
    head: list[tuple[Floats, Floats]] = field(default_factory=list)
    looked: int = 0

    def add(self, chunk: Chunk) -> None:
        """Look at a chunk."""
        known = np.isfinite(chunk.y)
        for k, x in enumerate((chunk.u, chunk.y[known])):
            if len(x):
                self.low[k], self.high[k] = min(self.low[k], x.min()), max(self.high[k], x.max())
        if self.looked < LOOKED_AT:
            self.head.append((chunk.u, chunk.y))
            self.looked += len(chunk.u)

    def notes(self) -> Sequence[str]:
        """Return what is worth a note; raise for columns that are dead or swapped."""
        where = self.table.where
        for k, column in enumerate(("input", "output")):
            if not np.isfinite(self.low[k]):
                raise WhidError("data-missing", f"the {column} has no number at all", where(0))
            checks.check_alive(np.array([self.low[k], self.high[k]]), column, where)
        u, y = (np.concatenate(column) for column in zip(*self.head, strict=True))
        known = np.isfinite(y)
        series = Series(np.arange(len(u), dtype=float), u, grid.filled(y, known, hold=False), known)
        looks: tuple[str, ...] = ()
        if self.source.causal and known.any() and np.ptp(series.input) > 0 and np.ptp(series.output) > 0:
            checks.check_order_of_columns(series.input, series.output, where)
            looks = checks.like_a_command(series.input, series.output)
        return looks
