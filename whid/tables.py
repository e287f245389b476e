"""How a `Table` reads: its cells, Markdown (summary.md), JSON. Pure; the terminal is cli/_print.py's business."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from whid.quantity import Cell, Measured, Table

EXACT = 1e-13  # relative: a standard error below is rounding


def cell(value: Cell) -> str:
    """Return a cell as people read it; a `Measured` by `measured`.

    >>> [cell(x) for x in (None, True, 3, 0.1234567, "white")]
    ['', 'yes', '3', '0.123457', 'white']
    """
    if value is None:
        return ""
    if isinstance(value, Measured):
        return measured(*value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def measured(value: float, std: float) -> str:
    """Return value ± std: the error to two significant digits, the value to the same decimals.

    >>> measured(31.2537, 0.00412), measured(-1234.5, 120.0), measured(2.5e-7, 3.1e-9), measured(1.5, math.inf)
    ('31.2537 ± 0.0041', '-1230 ± 120', '(2.500 ± 0.031)e-07', '1.5 ± not determined')
    >>> measured(5.0, 1e-16), measured(-0.01, 2.0)  # a clipped sensor has no noise
    ('5', '0.0 ± 2.0')
    """
    if not math.isfinite(value) or math.isnan(std) or std <= EXACT * abs(value):
        return cell(float(value))
    if math.isinf(std):
        return f"{value:.6g} ± not determined"
    power = math.floor(math.log10(max(abs(value), std)))
    shared = power if not -4 <= power < 6 else 0
    value, std = value / 10.0**shared, std / 10.0**shared
    decimals = 1 - math.floor(math.log10(float(f"{std:.1e}")))  # of the rounded error: 0.0996 is 0.10
    value, std = round(value, decimals) + 0.0, round(std, decimals)  # never −0
    text = f"{value:.{max(decimals, 0)}f} ± {std:.{max(decimals, 0)}f}"
    return f"({text})e{shared:+03d}" if shared else text


def in_units(text: str, units: Mapping[str, str]) -> str:
    """Return `mean, output` with the record's unit of the output, or without where it has none.

    >>> in_units("mean, output", {"output": "V"}), in_units("mean, output", {"output": "1"}), in_units("gain, nat", {})
    ('mean, V', 'mean', 'gain, nat')
    """
    what, comma, unit = text.rpartition(", ")
    if not comma or unit not in units:
        return text
    return f"{what}, {units[unit]}" if units[unit] != "1" else what


def markdown(table: Table) -> str:
    """Return a table as Markdown, title and notes included.

    >>> print(markdown(Table("Fit", ("what", "rms"), (("report", Measured(0.298, 0.004)),))))
    ### Fit
    <BLANKLINE>
    | what | rms |
    |:--|--:|
    | report | 0.2980 ± 0.0040 |
    """
    right = numeric(table)
    lines = [f"### {table.title}", ""] if table.title else []
    if table.rows:
        lines.append(_row(table.columns))
        lines.append("|" + "|".join("--:" if number else ":--" for number in right) + "|")
        lines += [_row(cell(value) for value in row) for row in table.rows]
    return "\n".join(lines + [f"\n{note}" for note in table.notes])


def as_csv(table: Table) -> str:
    """Return a table as CSV: full precision, a column `<name> error` beside every one that holds `Measured`.

    >>> print(as_csv(Table("Fit", ("what", "rms"), (("report", Measured(0.298, 0.004)), ("selection", None)))), end="")
    what,rms,rms error
    report,0.298,0.004
    selection,,
    """
    wide = [any(isinstance(row[j], Measured) for row in table.rows) for j in range(len(table.columns))]

    def spread(cells: Iterable[Cell]) -> Iterator[object]:
        for value, two in zip(cells, wide, strict=True):
            yield from (value if isinstance(value, Measured) else (value, None)) if two else (value,)

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = zip(table.columns, wide, strict=True)
    writer.writerow([name for column, two in names for name in ((column, f"{column} error") if two else (column,))])
    writer.writerows(list(spread(row)) for row in table.rows)
    return text.getvalue()


def as_json(table: Table) -> dict[str, Any]:
    """Return a table as JSON holds it: rows are objects keyed by column, a `Measured` is {value, std}.

    >>> as_json(Table("Fit", ("what", "rms"), (("report", Measured(0.3, math.nan)),)))["rows"]
    [{'what': 'report', 'rms': {'value': 0.3, 'std': None}}]
    """
    rows = [dict(zip(table.columns, map(jsonable, row), strict=True)) for row in table.rows]
    return {"title": table.title, "columns": list(table.columns), "rows": rows, "notes": list(table.notes)}


def jsonable(value: Any) -> Any:
    """Return a value in JSON's types: numpy numbers and arrays unpacked, NaN and infinities as null."""
    if isinstance(value, Measured):
        return {"value": jsonable(value.value), "std": jsonable(value.std)}
    if isinstance(value, Table):
        return as_json(value)
    if isinstance(value, dict):
        return {str(key): jsonable(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple)):
        return [jsonable(item) for item in value]
    if isinstance(value, complex):
        return {"real": jsonable(value.real), "imag": jsonable(value.imag)}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def numeric(table: Table) -> list[bool]:
    """Tell of every column whether it holds numbers only."""
    columns = [[row[j] for row in table.rows if row[j] is not None] for j in range(len(table.columns))]
    return [bool(c) and all(isinstance(x, (int, float, Measured)) and not isinstance(x, bool) for x in c) for c in columns]


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in cells) + " |"
