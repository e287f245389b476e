"""How a `Table` gets onto the terminal (rich), and JSON onto stdout."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from whid.quantity import Table
from whid.tables import as_json, cell, jsonable, markdown, measured, numeric

if TYPE_CHECKING:
    from rich.table import Table as RichTable

__all__ = ["as_json", "cell", "jsonable", "markdown", "measured", "print_json", "print_tables"]
WIDE = 240  # columns of a pipe: nothing wraps, so that grep and awk see whole rows


def print_json(value: Any) -> None:
    """Print one JSON value on stdout, and nothing else."""
    print(json.dumps(jsonable(value), indent=2, ensure_ascii=False))


def print_tables(*tables: Table) -> None:
    """Print tables on stdout: rich on a terminal, unwrapped in a pipe."""
    from rich.console import Console
    from rich.text import Text

    console = Console(file=sys.stdout, highlight=False, width=None if sys.stdout.isatty() else WIDE)
    with console.capture() as captured:
        for number, table in enumerate(tables):
            if number:
                console.print()
            if table.title:
                console.print(Text(table.title, "bold"))
            if table.rows:
                console.print(_rich(table))
            for note in table.notes:
                console.print(Text(note))
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))


def _rich(table: Table) -> RichTable:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for name, right in zip(table.columns, numeric(table), strict=True):
        shown.add_column(Text(name), justify="right" if right else "left", overflow="fold")
    for row in table.rows:
        shown.add_row(*(Text(cell(value)) for value in row))  # Text: brackets in a cell are not markup
    return shown
