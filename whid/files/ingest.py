"""From a data file to a Record: read, put on a uniform grid, check, operate, find the parts."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.files import checks, grid
from whid.files.source import DataSource, locate
from whid.files.table import Table, open_table
from whid.kinds import plain
from whid.operations._operation import Series
from whid.quantity import UNIX
from whid.record import Initial, Record
from whid.signal import Floats
from whid.stages.find_parts import find_parts

STEPS = {"dt": 1.0, "ts": 1.0, "h": 1.0, "t_s": 1.0}  # scalars that files name their sampling time by
ROLES = ("time", "input", "output")
BEGINNING, STILL = 8, 0.01  # samples that tell whether u is at rest first, and how much of its range they may move
RATES = ("fs", "rate_hz", "rate", "f_s")


class Ingested(NamedTuple):
    """A measured record, what was noticed on the way, and which file it was."""

    record: Record
    notes: tuple[str, ...]
    sha256: str


class Chosen(NamedTuple):
    """Column numbers."""

    time: int | None
    input: int
    output: int


def ingest(source: DataSource, base: Path, *, alone: bool = False) -> Ingested:
    """Return the record of a data source; `base` is the folder of the config that names it.

    alone: a file without an output column will do, its y is missing everywhere. Raises `WhidError` with a code `data-…`,
    the file and, where there is one, the row.
    """
    path, table = locate(source.file, base), opened(source, base)
    try:
        record, notes = _record(source, table, path, alone)
    except WhidError as fault:
        raise fault if fault.where else WhidError(fault.code, fault.message, path.name) from fault
    with path.open("rb") as file:
        return Ingested(record, notes, hashlib.file_digest(file, "sha256").hexdigest())


def check_columns(source: DataSource, base: Path) -> None:
    """Raise `WhidError` for a file that is not there, cannot be read, or lacks a column; its rows are not looked at."""
    try:
        choose(source, opened(source, base))
    except WhidError as fault:
        raise fault if fault.where else WhidError(fault.code, fault.message, source.file) from fault


def opened(source: DataSource, base: Path) -> Table:
    """Return the table of a source's file."""
    path = locate(source.file, base)
    return open_table(path, delimiter=source.delimiter, decimal=source.decimal, header_lines=source.header_lines)


def _record(source: DataSource, table: Table, path: Path, alone: bool) -> tuple[Record, tuple[str, ...]]:
    chosen, notes = choose(source, table, alone)
    u, y, *times = table.load([k for k in (chosen.input, chosen.output, chosen.time) if k is not None])
    _check_equal(table, chosen, [u, y, *times])
    checks.check_length(len(u), path.name)
    series, more = _on_grid(source, table, chosen, u, y, times[0] if times else None)
    del u, y, times
    series, operated = _operate(source, table, series, path)
    checks.check_length(len(series.time), path.name)
    dt, t0 = grid.tidy(series.dt, len(series.time) - 1, float(series.time[-1])), float(series.time[0])
    parts, found = _parts(source, series, dt)
    units = {
        "input": source.units.get("input") or table.units.get(table.names[chosen.input], "1"),
        "output": source.units.get("output") or table.units.get(table.names[chosen.output], "1"),
    }
    if chosen.output == chosen.input:
        series.valid[:] = False
    whole = bool(series.valid.all())
    initial = source.initial or begins(series.input)
    record = Record(
        series.input, series.output if whole else np.where(series.valid, series.output, np.nan), dt, t0,
        None if whole else series.valid, units, source.intersample, initial, parts, source.name, source.use,
    )  # fmt: skip
    return record, (*notes, *more, *operated, *found)


def begins(u: Floats) -> Initial:
    """Return the state that a record of nothing declared begins in: steady where its input is at rest first, else free.

    To take the first sample of an input that moves at once for a level puts a step in front of it that never was.
    """
    return "steady" if np.ptp(u[:BEGINNING]) <= STILL * np.ptp(u) else "free"


def choose(source: DataSource, table: Table, alone: bool = False) -> tuple[Chosen, tuple[str, ...]]:
    """Return the columns of a source, those not declared guessed from their names, and a note on the guess.

    Raises `WhidError("data-column")` where a column is neither there nor to be guessed.
    """
    given = {role: getattr(source.columns, role) for role in ROLES}
    known = {role: table.find(column) for role, column in given.items() if column is not None}
    timed = bool(source.dt or source.rate_hz)
    wanted = [role for role in (("input", "output") if timed else ROLES) if role not in known]
    if not table.named and not known:  # no headings: in the order time, input, output; of two columns, none is the time
        known = dict(zip(wanted[-max(len(table.names), 1) :], range(len(table.names)), strict=False))
    else:
        known |= {role: k for role in wanted if (k := table.guess(role)) is not None}
    if alone and "output" not in known and "input" in known:  # the input stands in for an output nobody will look at
        return Chosen(known.get("time"), known["input"], known["input"]), (
            f"no output: input = {table.names[known['input']]}",
        )
    for role in ("input", "output"):
        if role not in known:
            raise WhidError("data-column", f"which column is the {role}? {_offered(table, known, wanted)}")
    if len(set(known.values())) < len(known):
        raise WhidError("data-column", "time, input and output must be different columns")
    guessed = [f"{role} = {table.names[known[role]]}" for role in wanted if role in known]
    notes = (f"columns guessed: {', '.join(guessed)}",) if guessed else ()
    return Chosen(known.get("time"), known["input"], known["output"]), notes


def _offered(table: Table, known: dict[str, int], wanted: Sequence[str]) -> str:
    """Return what there is to choose from, and where nothing is left over what to type, in the order time, input, output."""
    has = f"The file has {', '.join(table.names[:20]) or 'no column of numbers'}"
    if len(table.names) < 2:
        return f"{has}; an input and an output are needed"
    rest = [k for k in range(len(table.names)) if k not in known.values()]
    open_roles = [role for role in wanted if role not in known]
    if len(rest) != len(open_roles):
        return has
    choice = known | dict(zip(open_roles, rest, strict=True))
    return f"{has}; perhaps {','.join(f'{role}={table.names[choice[role]]}' for role in ROLES if role in choice)}"


def _check_equal(table: Table, chosen: Chosen, columns: Sequence[Floats]) -> None:
    names = [table.names[k] for k in (chosen.input, chosen.output, chosen.time) if k is not None]
    if len({len(column) for column in columns}) > 1:
        lengths = ", ".join(f"{name} {len(column)}" for name, column in zip(names, columns, strict=True))
        raise WhidError("data-length", f"the columns differ in length: {lengths}")


def _on_grid(
    source: DataSource, table: Table, chosen: Chosen, u: Floats, y: Floats, time: Floats | None
) -> tuple[Series, tuple[str, ...]]:
    """Return the raw columns on one grid (or on increasing times, when a resampling follows), checked."""
    declared = source.dt or (1 / source.rate_hz if source.rate_hz else None)
    hold, where = source.intersample == "zoh", table.where
    notes: tuple[str, ...] = ()
    if time is None:
        dt, notes = (declared, ()) if declared else step_in(table)
        uniform = grid.Grid(dt, 0.0, None, 0.0)
    else:
        time, notes = seconds(source, table, chosen, time, declared)
        grid.check_order(time, where)
        if any(operation.kind == "resample" for operation in source.operations):
            series, more = grid.complete(time, u, y, source.missing, hold, where)
            return _checked(source, table, series), (*notes, *more)
        uniform = grid.uniform(time, where)
        if declared:
            grid.check_step(uniform.dt, declared, where)
    if uniform.jitter > 1e-6 + 2 * np.spacing(abs(uniform.t0)) / uniform.dt:  # more than the digits of the time explain
        notes = (*notes, f"time jitter of {100 * uniform.jitter:.2g} % of a step accepted")
    if uniform.places is not None:
        where = _row_of(uniform, table)
    u, y = grid.spread(u, uniform), grid.spread(y, uniform)
    times: Floats = uniform.t0 + uniform.dt * np.arange(len(u), dtype=float)
    series, more = grid.complete(times, u, y, source.missing, hold, where)
    looks = checks.like_a_command(series.input, series.output) if source.causal else ()
    series = _checked(source, table, series)
    looks = (*looks, *checks.stuck(series.input, series.output, where), *checks.far_out(series.output, "output", where))
    return series, (*notes, *more, *looks)


def _checked(source: DataSource, table: Table, series: Series) -> Series:
    checks.check_alive(series.input, "input", table.where)
    checks.check_alive(series.output[series.valid], "output", table.where)
    if source.causal:
        checks.check_order_of_columns(series.input, series.output, table.where)
    return series


def _row_of(uniform: grid.Grid, table: Table) -> grid.Where:
    """Return where a sample of a grid with holes is: its row, or the row before the hole."""
    index = np.asarray(uniform.places)
    return lambda sample: table.where(int(np.searchsorted(index, sample, side="right")) - 1)


def step_in(table: Table) -> tuple[float, tuple[str, ...]]:
    """Return the sampling time that the file itself names among its scalars."""
    for name, value in table.scalars.items():
        key = name.casefold().rpartition("/")[2].rpartition(".")[2]
        if value > 0 and (key in STEPS or key in RATES):
            return (value if key in STEPS else 1 / value), (f"sampling time from the file's {name} = {value:g}",)
    raise WhidError("data-column", f"no time column among {', '.join(table.names[:20])}; give dt: or rate_hz:")


def seconds(
    source: DataSource, table: Table, chosen: Chosen, time: Floats, declared: float | None
) -> tuple[Floats, tuple[str, ...]]:
    """Return the time column in seconds; a unit in the file's heading and a declared one must agree."""
    name = table.names[chosen.time or 0]
    written = table.units.get(name, "")
    if not written and "_" in name:
        written = name.rpartition("_")[2]
    written = written if written in grid.SECONDS else ""
    unit = source.units.get("time") or written or "s"
    if unit not in grid.SECONDS:
        raise WhidError("data-time-unit", f"no unit of time: {unit!r}; allowed are {', '.join(grid.SECONDS)}")
    if written and grid.SECONDS[written] != grid.SECONDS[unit]:
        raise WhidError("data-time-unit", f"the column {name} is in {written}, the config says {unit}")
    note: tuple[str, ...] = () if unit == "s" else (f"time in {unit}, turned into s",)
    told = declared is not None or written or "time" in source.units or time[0] >= UNIX[0]
    if not told and len(time) > 1 and bool((time == np.rint(time)).all()):
        note = (f"time steps by whole numbers ({time[1] - time[0]:g}): if that is not in s, say units: {{time: ms}}",)
    return np.asarray(time if unit == "s" else time * grid.SECONDS[unit]), note


def _operate(source: DataSource, table: Table, series: Series, path: Path) -> tuple[Series, tuple[str, ...]]:
    """Return the series after all operations, and a note for each."""
    notes, uniform = [], not any(operation.kind == "resample" for operation in source.operations)
    for operation in source.operations:
        uniform = uniform or operation.kind == "resample"
        if not (uniform or operation.any_grid):
            raise WhidError("data-operation", f"{operation.kind} needs uniform times: put resample before it")
        series = operation.apply(series, table.scalars)
        words = [f"{key} {value}" for key, value in plain(operation).items() if key != "kind"]
        notes.append(f"operation {operation.kind}" + (f": {', '.join(words)}" if words else ""))
        if not all(float(np.abs(x).max()) <= checks.HUGE for x in (series.input, series.output)):
            raise WhidError("data-operation", f"{operation.kind} left numbers that are not finite, or huge", path.name)
    if not series.valid.all() and source.missing == "error":  # holes that a resampling met
        first = float(series.time[np.flatnonzero(~series.valid)[0]])
        raise WhidError(
            "data-missing", f"{int((~series.valid).sum())} samples are missing, the first at {first:g} s", path.name
        )
    return series, tuple(notes)


def _parts(source: DataSource, series: Series, dt: float) -> tuple[tuple[Part, ...], tuple[str, ...]]:
    """Return the placed parts: found, or as declared; those without `start` follow the one before."""
    if source.parts == "auto":
        parts = find_parts(series.input, dt, source.use)
        kinds = [part.kind for part in parts]
        found = ", ".join(f"{kinds.count(kind)} {kind}{'s' * (kinds.count(kind) > 1)}" for kind in dict.fromkeys(kinds))
        return parts, (f"parts found: {found or 'none'}",)
    return placed(source, dt, len(series.time)), ()


def placed(source: DataSource, dt: float, samples: int) -> tuple[Part, ...]:
    """Return the declared parts, each at its place; raise `WhidError("data-parts")` for one beyond the record."""
    assert source.parts != "auto"
    placed: list[Part] = []
    cursor = 0
    for k, whole in enumerate(source.parts):
        cursor = cursor if whole.start is None else whole.start
        for part in whole.expand(dt):
            if part.start is None or part.stop is None:
                part = part.placed(cursor, dt)
            cursor = part.stop or 0
            if not cursor > (part.start or 0) or cursor > samples:
                message = f"parts[{k}] ({part.kind}) covers samples {part.start} … {part.stop} of a record of {samples}"
                raise WhidError("data-parts", message)
            placed.append(part)
    return tuple(placed)
