"""How a text table is written: delimiter, decimal mark, where the data start, headings and units. Pure."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime, time
from typing import NamedTuple

from whid.errors import WhidError
from whid.files.table import bare

DELIMITERS = {"tab": "\t", ";": ";", ",": ",", "space": " "}
MISSING = frozenset(("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?"))
# fmt: off
UNITS = frozenset((  # lower case
    "", "s", "ms", "us", "µs", "μs", "ns", "min", "h", "hz", "khz", "v", "mv", "kv", "a", "ma", "n", "mn", "kn",
    "nm", "m", "mm", "cm", "µm", "m/s", "mm/s", "m/s²", "m/s^2", "rad", "rad/s", "deg", "deg/s", "°", "°/s", "°c",
    "k", "pa", "kpa",
    "bar", "mbar", "rpm", "1/min", "kg", "g", "w", "kw", "%", "-", "1", "l/s", "l/min", "m3/s", "m³/s", "t",
))
# fmt: on
NEAR = 3  # lines above the data, blank ones apart, among which are headings and units


class Dialect(NamedTuple):
    """What `sniff` found."""

    delimiter: str  # one character; " " stands for any run of blanks
    decimal: str
    first: int  # lines before the data
    cells: int  # cells a row
    names: tuple[str, ...]
    units: dict[str, str]
    named: bool


class Shape(NamedTuple):
    """One way to read the lines: how many rows it explains, and how."""

    rows: int
    numbers: int  # cells that are numbers, in a row
    cells: int
    first: int


def sniff(lines: Sequence[str], delimiter: str | None = None, decimal: str | None = None, header_lines: int = 0) -> Dialect:
    """Return the dialect that makes the most lines, then the most cells of a line, numbers.

    Raises `WhidError("data-unreadable")` when no line holds a number.

    >>> sniff(["t;u;y", "0;1,5;2", "1;1,5;3"])[:5]
    (';', ',', 1, 3, ('t', 'u', 'y'))
    """
    delimiters = [DELIMITERS[delimiter]] if delimiter else list(DELIMITERS.values())
    ways = [(d, mark) for d in delimiters for mark in ([decimal] if decimal else ".,") if d != mark]
    shapes = [(_shape(lines[header_lines:], *way), way) for way in ways]
    best, (mark_between, mark) = max(shapes, key=lambda found: (found[0].rows, found[0].numbers, -found[0].cells))
    if best.rows == 0:
        raise WhidError("data-unreadable", "no row of numbers in the first lines")
    first = header_lines + best.first
    headed = any(len(row) == best.cells and row[-1] for row in (split(line, mark_between) for line in lines[:first]))
    empty_end = not headed and all(split(line, mark_between)[-1:] == [""] for line in lines[first:] if line.strip())
    width = best.cells - (1 if empty_end and best.cells > 1 else 0)
    names, units = _headings(lines[:first], mark_between, width, best.cells)
    return Dialect(mark_between, mark, first, best.cells, names or tuple(map(str, range(width))), units, bool(names))


def split(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, quotes and blanks around them removed."""
    if delimiter == " ":
        return line.replace('"', "").split()
    if '"' not in line:
        return [cell.strip() for cell in line.rstrip("\r\n").split(delimiter)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]


def number(cell: str, decimal: str) -> float | None:
    """Return a cell's value, NaN where it says that it is missing, None where it is no number.

    >>> number("1,5", ","), number("n/a", "."), number("1_0", ".")
    (1.5, nan, None)
    """
    if cell.casefold() in MISSING:
        return float("nan")
    if "_" in cell or (decimal == "," and "." in cell):
        return None
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return None


def clock(cell: str) -> float | None:
    """Return the seconds of an ISO 8601 date with time, since 1970 (UTC unless it says otherwise), or of a time of day.

    >>> clock("2024-03-05T10:00:00.25") - clock("2024-03-05 10:00:00"), clock("10:00:00,5"), clock("05.03.2024 10:00")
    (0.25, 36000.5, None)
    """
    try:
        day = time.fromisoformat(cell)
        return 3600.0 * day.hour + 60.0 * day.minute + day.second + 1e-6 * day.microsecond
    except ValueError:
        pass
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _shape(lines: Sequence[str], delimiter: str, decimal: str) -> Shape:
    """Return the commonest pattern of numbers and words among the lines, and where it starts."""
    patterns = [_pattern(line, delimiter, decimal) for line in lines]
    counted = Counter(p for p in patterns if True in p)
    if not counted:
        return Shape(0, 0, 0, 0)
    common = max(counted, key=lambda p: (counted[p], sum(x is True for x in p)))
    fits = [len(p) == len(common) and True in p and all(a is b or None in (a, b) for a, b in zip(p, common, strict=True))
            for p in patterns]  # fmt: skip
    return Shape(sum(fits), common.count(True), len(common), fits.index(True))


def _pattern(line: str, delimiter: str, decimal: str) -> tuple[bool | None, ...]:
    """Return for each cell: True a number, False a word, None missing."""
    values = [number(cell, decimal) for cell in split(line, delimiter)] if line.strip() else []
    return tuple(False if value is None else None if value != value else True for value in values)


def _headings(above: Sequence[str], delimiter: str, width: int, cells: int) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return names and units from the lines above the data: the nearest that has as many cells, a row of units skipped."""
    near = [line.lstrip("#%/! \ufeff") for line in reversed(above) if line.strip()][:NEAR]
    if delimiter == " ":
        near = [re.sub(r"\s+(?=[\[(])", "", line) for line in near]  # `u [V]` is one heading
    rows = [row[:width] for row in (split(line, delimiter) for line in near) if len(row) in (width, cells) and any(row)][:2]
    if not rows:
        return (), {}
    has_units = len(rows) == 2 and all(cell.strip("[]() ").casefold() in UNITS for cell in rows[0])
    heads = [bare(cell) for cell in rows[1 if has_units else 0]]
    units = [cell.strip("[]() ") for cell in rows[0]] if has_units else [unit for _, unit in heads]
    names = [name or str(k) for k, (name, _) in enumerate(heads)]
    if len(set(names)) < len(names):
        names = [name if names.count(name) == 1 else f"{name}.{k}" for k, name in enumerate(names)]
    return tuple(names), {name: unit for name, unit in zip(names, units, strict=True) if unit}
