"""What a CI job keeps of a run: JUnit XML, and a Markdown summary where the CI service shows it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from whid.files.gate import append, junit_xml
from whid.quantity import Table
from whid.result import Check

MOST_ROWS = 200  # of a summary that people scroll through
STEP_SUMMARY = "GITHUB_STEP_SUMMARY"


def tell(
    name: str, checks: Sequence[Check], tables: Sequence[Table], code: int, summary: Path | None, junit: Path | None
) -> None:
    """Write what was asked for; the summary also to where `$GITHUB_STEP_SUMMARY` points."""
    if junit:
        junit_xml(junit, name, checks, code)
    targets = {Path(p).absolute() for p in (summary, os.environ.get(STEP_SUMMARY)) if p}
    if targets:
        text = page(name, checks, tables, code)
        for target in sorted(targets):
            append(target, text)


def page(name: str, checks: Sequence[Check], tables: Sequence[Table], code: int) -> str:
    """Return the Markdown: verdict, bounds, tables."""
    from whid.summary import expected
    from whid.tables import markdown

    verdict = {0: "passed", 3: "incomplete", 4: "a bound is breached", 5: "not measured"}.get(code, f"exit code {code}")
    shown = [expected(checks), *(_short(table) for table in tables)]
    return "\n\n".join([f"## whid {name}: {verdict}", *(markdown(table) for table in shown if table.rows)]) + "\n"


def _short(table: Table) -> Table:
    left = len(table.rows) - MOST_ROWS
    if left <= 0:
        return table
    return table._replace(rows=table.rows[:MOST_ROWS], notes=(*table.notes, f"{left} more rows in the sweep's own files"))
