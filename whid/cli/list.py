"""List runs, sweeps and tables with their headlines, the newest first."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from whid.quantity import Table


@click.command()
@click.argument("out", type=click.Path(path_type=Path), default=Path("runs"))
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
def command(out: Path, as_json: bool) -> int:
    """List runs, sweeps and tables with their headlines, the newest first; unfinished sweeps with how far they are.

    Example: whid list runs
    """
    from whid.cli._print import print_json, print_tables

    table = listed(out)
    if as_json:
        print_json(table)
    else:
        print_tables(table)
    return 0


def listed(out: Path) -> Table:
    """Return one row a folder of `out`; raise `WhidError("run-not-found")` where there is no such folder."""
    from whid.errors import WhidError
    from whid.files.headline import headline
    from whid.quantity import Table

    if not out.is_dir():
        raise WhidError("run-not-found", "no such folder", str(out))
    visible = [path for path in out.iterdir() if not path.name.startswith(".")]
    rows = []
    for path in sorted(visible, key=lambda path: path.stat().st_mtime, reverse=True):
        found = headline(path) if path.is_dir() else _unfinished(path)
        if found:
            when = datetime.fromtimestamp(path.stat().st_mtime).strftime("%Y-%m-%d %H:%M")
            rows.append((path.name, *found, when))
    notes = () if rows else (f"nothing of whid in {out}",)
    return Table(f"{out}", ("name", "kind", "headline", "finished"), tuple(rows), notes)


def _unfinished(path: Path) -> tuple[str, str] | None:
    from whid.errors import WhidError
    from whid.files.journal import UNFINISHED, progress

    if path.suffix != UNFINISHED:
        return None
    try:
        found = progress(path)
    except WhidError:
        return "unreadable", "no journal of a sweep"
    return (
        "unfinished sweep",
        "a process is at it" if found is None else f"{found[0]} of {found[1]} done; the same command goes on",
    )
