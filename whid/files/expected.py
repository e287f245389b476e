"""Regenerated tables as CSV, and the comparison of one with the committed `<config>.expected.csv`.

One line a row: table, quantity, then value and standard error of every column, then the row's own tolerance if it has one.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from whid.errors import WhidError
from whid.quantity import Cell, Measured

RELATIVE = 1e-3  # by which a number without a standard error may move


class Cells(NamedTuple):
    """One row: of which table, of what, its cells by column, and what its numbers may move by if not by their errors."""

    table: str
    quantity: str
    cells: Mapping[str, Cell]
    tolerance: float | None


def beside(config: Path) -> Path:
    """Return where the expected table of a config stands.

    >>> beside(Path("configs/paper/table-1.yaml")).as_posix()
    'configs/paper/table-1.expected.csv'
    """
    return config.with_name(f"{config.stem}.expected.csv")


def text(rows: Sequence[Cells]) -> str:
    """Return rows, all with the same columns, as CSV.

    >>> print(text([Cells("t", "gain", {"published": 0.98, "ours": Measured(0.979, 0.001)}, None)]))
    table,quantity,published,published_std,ours,ours_std,tolerance
    t,gain,0.98,,0.979,0.001,
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    pairs = [name for column in rows[0].cells for name in (column, f"{column}_std")]
    writer.writerow(("table", "quantity", *pairs, "tolerance"))
    for row in rows:
        pairs = [part for cell in row.cells.values() for part in _written(cell)]
        writer.writerow((row.table, row.quantity, *pairs, "" if row.tolerance is None else f"{row.tolerance:.6g}"))
    return out.getvalue()


def read(path: Path) -> list[Cells]:
    """Return the rows of such a CSV; raise `WhidError("table-expected")` where there is none or it is something else."""
    try:
        lines = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
        if not lines or None in lines[0] or not {"table", "quantity", "tolerance"} <= set(lines[0]):
            raise ValueError("not a table that whid wrote")
        return [_row(line) for line in lines]
    except (OSError, ValueError, KeyError) as fault:
        raise WhidError("table-expected", getattr(fault, "strerror", None) or str(fault), str(path)) from None


def drift(wanted: Sequence[Cells], found: Sequence[Cells]) -> Iterator[str]:
    """Yield every cell that is not as expected, in words.

    A number may move by its expected standard error, or by 1e-3 of itself if it has none, or by the row's tolerance.
    """
    ours = {(row.table, row.quantity): row for row in found}
    theirs = {(row.table, row.quantity): row for row in wanted}
    for at, row in theirs.items():
        if at not in ours:
            yield f"{at[0]}: {at[1]}: the row is gone"
            continue
        for column in row.cells.keys() | ours[at].cells.keys():
            was, now = row.cells.get(column), _read(*_written(ours[at].cells.get(column)))  # as it would read back
            if not _same(was, now, row.tolerance):
                yield f"{at[0]}: {at[1]}, {column}: expected {_said(was)}, now {_said(now)}"
    yield from (f"{table}: {quantity}: a new row" for table, quantity in ours.keys() - theirs.keys())


def _same(was: Cell, now: Cell, tolerance: float | None) -> bool:
    if not isinstance(was, (float, Measured)) or not isinstance(now, (float, Measured)):
        return was == now
    a, error = (was.value, was.std) if isinstance(was, Measured) else (was, float("nan"))
    b = now.value if isinstance(now, Measured) else now
    allowed = tolerance if tolerance is not None else error if error == error else RELATIVE * abs(a)
    return abs(a - b) <= allowed or a == b or (a != a and b != b)


def _said(cell: Cell) -> str:
    return f"{cell.value:.6g} ± {cell.std:.2g}" if isinstance(cell, Measured) else "nothing" if cell is None else str(cell)


def _written(cell: Cell) -> tuple[str, str]:
    if isinstance(cell, Measured):
        return f"{cell.value:.9g}", f"{cell.std:.3g}"
    return ("" if cell is None else f"{cell:.9g}" if isinstance(cell, float) else str(cell)), ""


def _read(value: str, std: str) -> Cell:
    if not value:
        return None
    try:
        return Measured(float(value), float(std)) if std else float(value)
    except ValueError:
        return value


def _row(line: Mapping[str, str]) -> Cells:
    columns = [name for name in line if f"{name}_std" in line]
    found = {column: _read(line[column], line[f"{column}_std"]) for column in columns}
    return Cells(line["table"], line["quantity"], found, float(line["tolerance"]) if line["tolerance"] else None)
