"""What a number in a result means: its unit, its axes, its standard error; and the tables that people read.

A stage's NamedTuple annotates its fields, `mean: Annotated[Floats, Quantity("output", ("level",), error="std")]`, and the
result file, the tables and the pictures need no list of their own.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import NamedTuple

UNIX = 1e9, 1e11  # s since 1970: between them a time is one of the calendar, of 2001 or later


class Quantity(NamedTuple):
    """Annotation of a result's field.

    units: "input", "output", "output/input", "s", "rad/s", "rad", "1", …; "input" and "output" become the record's units
    dims:  one name an axis; a field of that name, if there is one, is the axis' scale
    error: the field that holds the standard error of this one
    """

    units: str = "1"
    dims: tuple[str, ...] = ()
    error: str = ""


class Measured(NamedTuple):
    """A number with its standard error, printed as value ± error."""

    value: float
    std: float


Cell = str | int | float | Measured | None


class Table(NamedTuple):
    """A table as data; how it looks is the business of whoever prints it."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()


def moment(time: float) -> str:
    """Return a time in s as people read it: a date where it counts from 1970.

    >>> moment(1709632800.5), moment(12.0)
    ('2024-03-05 10:00:00 UTC', '12 s')
    """
    return f"{datetime.fromtimestamp(time, UTC):%Y-%m-%d %H:%M:%S} UTC" if UNIX[0] <= time < UNIX[1] else f"{time:.12g} s"
