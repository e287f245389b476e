"""Run a study over the grid of its `sweep:` section, many times a cell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from whid.sweep_result import SweepResult

SHOWN = 10  # failures as they happen


@click.command()
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help="Where sweep folders go."
)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a value, e.g. sweep.repeats=20.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes.")
@click.option("--scheduler", metavar="ADDRESS", default="", help="A Dask cluster instead, e.g. tcp://host:8786.")
@click.option("--fail-fast", is_flag=True, help="Stop at the first repeat that fails.")
@click.option("--full-records", is_flag=True, help="Simulate every record, even where drawn statistics are the same.")
@click.option("--force", is_flag=True, help="Run again into a sibling folder, even when this sweep is done.")
@click.option("--summary", type=click.Path(path_type=Path), help="Add a Markdown summary to a file.")
@click.option("--junit", type=click.Path(path_type=Path), help="Write the bounds of `expect:` as JUnit XML.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
def command(
    config: Path, out: Path, overrides: tuple[str, ...], jobs: int, scheduler: str, fail_fast: bool,
    full_records: bool, force: bool, summary: Path | None, junit: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Run a study over the grid of its `sweep:` section, many times a cell; one that was interrupted goes on.

    Example: whid sweep noise.yaml --jobs 2
    """
    from whid.cli._gate import tell
    from whid.sweep import sweep

    overrides = (*overrides, "sweep.full_records=true") if full_records else overrides
    try:
        with _Bar() as bar:
            found = sweep(
                config, out, overrides, jobs=jobs, scheduler=scheduler, force=force, fail_fast=fail_fast, watch=bar
            )  # fmt: skip
    except KeyboardInterrupt:
        click.echo("what is finished is kept: the same command goes on, `whid list` shows how far it is", err=True)
        raise
    code = report(found, as_json)
    tell(found.name, found.checks, [found.table(), found.failures()], code, summary, junit)
    return code


def report(found: SweepResult, as_json: bool) -> int:
    """Print a sweep's tables, or one JSON object, its failures to stderr; return the exit code."""
    from whid.cli._print import print_json, print_tables
    from whid.summary import expected

    failures = found.failures()
    if as_json:
        checks = [check._asdict() | {"verdict": check.verdict} for check in found.checks]
        kept = {"name": found.name, "path": str(found.path), "reused": found.reused, "failed": found.failed}
        print_json(kept | {"table": found.table(), "failures": failures, "expect": checks})
    else:
        tables = [found.table(), failures, expected(found.checks)]
        print_tables(*(table for table in tables if table.rows))
        files = "  ".join(["sweep.h5", "sweep.csv", "summary.md", *found.pictures])
        print(f"\n{'reused, nothing was run: ' if found.reused else ''}{found.path}\n  {files}")
    for row in failures.rows:
        click.echo(f"failed {row[-2]} times at {', '.join(map(str, row[:-2]))}: {row[-1]}", err=True)
    return found.exit_code


class _Bar:
    """A progress bar on a terminal, a line every tenth elsewhere."""

    def __enter__(self) -> _Bar:
        from rich.console import Console
        from rich.progress import Progress

        self.tenth = self.faults = 0
        self.progress = Progress(console=Console(stderr=True)) if sys.stderr.isatty() else None
        self.to: dict[str, Any] = {"markup": False} if self.progress else {"file": sys.stderr, "flush": True}
        if self.progress:
            self.progress.start()
            self.task = self.progress.add_task("sweep", total=None)
        return self

    def __exit__(self, *_: object) -> None:
        if self.progress:
            self.progress.stop()

    def __call__(self, done: int, of: int, fault: str) -> None:
        if fault and self.faults < SHOWN:
            self.faults += 1
            more = "; further ones are listed at the end" if self.faults == SHOWN else ""
            (self.progress.console.print if self.progress else print)(f"{done}/{of} failed: {fault}{more}", **self.to)
        if self.progress:
            self.progress.update(self.task, completed=done, total=of)
        elif 10 * done // of > self.tenth:
            self.tenth = 10 * done // of
            print(f"{done}/{of}", file=sys.stderr, flush=True)
