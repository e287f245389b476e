"""Text tables: CSV, TSV, blanks; plain or gzipped."""

from __future__ import annotations

import codecs
import gzip
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TextIO, cast

import numpy as np

from whid.errors import WhidError
from whid.files.sniff import Dialect, clock, number, sniff, split
from whid.files.table import Table
from whid.signal import Floats

SAMPLE = 400  # lines that are looked at to find the dialect
CHUNK = 100_000  # lines at a time
LONGEST = 1_000_000  # characters of a line


def read(path: Path, delimiter: str | None = None, decimal: str | None = None, header_lines: int | None = None) -> Table:
    """Return the table of a text file; its dialect is found from the first lines unless it is given."""
    encoding = _encoding(path)
    with _open(path, encoding) as file:
        lines = list(islice(_lines(file, path), (header_lines or 0) + SAMPLE))
    dialect = sniff(lines, delimiter, decimal, header_lines or 0)
    blanks: list[int] = []  # line numbers of blank lines among the data, known once the columns are loaded

    def load(columns: Sequence[int]) -> list[Floats]:
        blanks.clear()
        with _open(path, encoding) as file:
            chunks = list(_chunks(islice(_lines(file, path), dialect.first, None), dialect, columns, path, blanks))
        return [np.concatenate([chunk[:, k] for chunk in chunks]) for k in range(len(columns))]

    def blocks(columns: Sequence[int]) -> Iterator[list[Floats]]:
        blanks.clear()
        with _open(path, encoding) as file:
            for chunk in _chunks(islice(_lines(file, path), dialect.first, None), dialect, columns, path, blanks):
                yield list(np.ascontiguousarray(chunk.T))

    def where(sample: int) -> str:
        row = dialect.first + 1 + sample
        for blank in blanks:
            row += blank <= row
        return f"{path.name}:{row}"

    units = dialect.units | {name: "s" for name in _clocks(lines[dialect.first :], dialect)}
    return Table(dialect.names, units, {}, load, where, dialect.named, blocks=blocks)


def _clocks(lines: Sequence[str], dialect: Dialect) -> list[str]:
    """Return the columns that hold dates or times of day, by their first row: these become seconds."""
    cells = split(next((line for line in lines if line.strip()), ""), dialect.delimiter)
    pairs = zip(dialect.names, cells, strict=False)
    return [name for name, cell in pairs if number(cell, dialect.decimal) is None and clock(cell) is not None]


def _chunks(
    lines: Iterator[str], dialect: Dialect, columns: Sequence[int], path: Path, blanks: list[int]
) -> Iterator[Floats]:
    row = dialect.first
    while chunk := list(islice(lines, CHUNK)):
        empty = [row + 1 + k for k, line in enumerate(chunk) if line.isspace()]
        blanks += empty
        kept = [line for line in chunk if not line.isspace()] if empty else chunk
        if kept:
            values = _fast(kept, dialect, columns)
            yield _slow(chunk, row, dialect, columns, path) if values is None else values
        row += len(chunk)


def _fast(lines: list[str], dialect: Dialect, columns: Sequence[int]) -> Floats | None:
    """Return the numbers by numpy's own reader, or None where something needs a closer look."""
    if dialect.delimiter != " " and {line.count(dialect.delimiter) for line in lines} != {dialect.cells - 1}:
        return None
    if dialect.decimal == ",":
        lines = [line.replace(",", ".") for line in lines] if not any("." in line for line in lines) else lines
    try:
        return np.loadtxt(
            lines,
            delimiter=None if dialect.delimiter == " " else dialect.delimiter,
            usecols=tuple(columns),
            comments=None,
            ndmin=2,
        )
    except ValueError:
        return None


def _slow(chunk: list[str], row: int, dialect: Dialect, columns: Sequence[int], path: Path) -> Floats:
    """Return the numbers cell by cell, empty ones NaN; raise naming file, row and column."""
    rows = []
    for line_number, line in enumerate(chunk, row + 1):
        if line.isspace():
            continue
        cells = split(line, dialect.delimiter)
        where = f"{path.name}:{line_number}"
        if len(cells) != dialect.cells and not (len(cells) == len(dialect.names) < dialect.cells):
            raise WhidError("data-cell", f"{len(cells)} cells, not {dialect.cells} as in the rows before", where)
        values = [number(cells[k], dialect.decimal) for k in columns]
        if None in values:
            values = [clock(cells[k]) if value is None else value for k, value in zip(columns, values, strict=True)]
        if None in values:
            k = columns[values.index(None)]
            raise WhidError("data-cell", f"column {dialect.names[k]}: {cells[k][:40]!r} is not a number", where)
        rows.append(values)
    return np.array(rows, float)


def _open(path: Path, encoding: str) -> TextIO:
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    return cast(TextIO, opener(path, "rt", encoding=encoding, errors="replace"))


def _lines(file: TextIO, path: Path) -> Iterator[str]:
    """Yield the lines; a line without end is no table (and must not fill the memory)."""
    while line := file.readline(LONGEST):
        if len(line) == LONGEST:
            raise WhidError("data-unreadable", f"a line of more than {LONGEST} characters", path.name)
        yield line


def _encoding(path: Path) -> str:
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    with opener(path, "rb") as file:
        head = file.read(4096)
    if not head.strip():
        raise WhidError("data-unreadable", "the file is empty", path.name)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    if b"\0" in head:
        raise WhidError("data-unreadable", "the file is not text", path.name)
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # may end within a character
    except UnicodeDecodeError:
        return "cp1252"  # what loggers and spreadsheets of western Windows write
    return "utf-8-sig"
