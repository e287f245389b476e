"""Run a study over the grid of its `sweep:` section, many times a cell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from whid.sweep import SweepResult


@click.command()
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help="Where sweep folders go."
)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a value, e.g. sweep.repeats=20.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes.")
@click.option("--force", is_flag=True, help="Run again into a sibling folder, even when this sweep is done.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
def command(config: Path, out: Path, overrides: tuple[str, ...], jobs: int, force: bool, as_json: bool) -> int:
    """Run a study over the grid of its `sweep:` section, many times a cell.

    Example: whid sweep noise.yaml --jobs 2
    """
    from whid.sweep import sweep

    with _Bar() as bar:
        found = sweep(config, out, overrides, jobs=jobs, force=force, watch=bar)
    return report(found, as_json)


def report(found: SweepResult, as_json: bool) -> int:
    """Print a sweep's tables, or one JSON object, its faults to stderr; return the exit code."""
    from whid.cli._print import print_json, print_tables
    from whid.summary import expected

    if as_json:
        checks = [check._asdict() | {"verdict": check.verdict} for check in found.checks]
        kept = {"name": found.name, "path": str(found.path), "reused": found.reused, "failed": found.failed}
        print_json(kept | {"table": found.table(), "expect": checks})
    else:
        tables = [found.table(), expected(found.checks)]
        print_tables(*(table for table in tables if table.rows))
        print(f"\n{'reused, nothing was run: ' if found.reused else ''}{found.path}\n  sweep.h5  summary.md")
    for reason in sorted({str(error) for error in found.errors.flat if error}):
        click.echo(f"failed: {reason}", err=True)
    verdicts = {check.verdict for check in found.checks}
    return 3 if found.failed else 4 if "breached" in verdicts else 5 if "not measured" in verdicts else 0


class _Bar:
    """A progress bar on a terminal, a line every tenth elsewhere."""

    def __enter__(self) -> _Bar:
        from rich.console import Console
        from rich.progress import Progress

        self.tenth = 0
        self.progress = Progress(console=Console(stderr=True)) if sys.stderr.isatty() else None
        if self.progress:
            self.progress.start()
            self.task = self.progress.add_task("sweep", total=None)
        return self

    def __exit__(self, *_: object) -> None:
        if self.progress:
            self.progress.stop()

    def __call__(self, done: int, of: int) -> None:
        if self.progress:
            self.progress.update(self.task, completed=done, total=of)
        elif 10 * done // of > self.tenth:
            self.tenth = 10 * done // of
            print(f"{done}/{of}", file=sys.stderr, flush=True)
