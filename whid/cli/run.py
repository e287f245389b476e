"""Run a study: simulate or ingest, identify, score, and keep the result in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from whid.cli._steps import Steps


@click.command()
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help="Where run folders go."
)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a value, e.g. plant.noise.std=0.1.")
@click.option("--force", is_flag=True, help="Run again into a sibling folder, even when this study is done.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
@click.option("-q", "--quiet", is_flag=True, help="Print the run's folder only; faults and bounds not met go to stderr.")
@click.option("--summary", type=click.Path(path_type=Path), help="Add a Markdown summary to a file.")
@click.option("--junit", type=click.Path(path_type=Path), help="Write the bounds of `expect:` as JUnit XML.")
@click.option("--max-memory", metavar="SIZE", default="4GB", show_default=True, help="Refuse a study that would need more.")
def command(
    config: Path, out: Path, overrides: tuple[str, ...], force: bool, as_json: bool, quiet: bool,
    summary: Path | None, junit: Path | None, max_memory: str,
) -> int:  # fmt: skip
    """Run a study: simulate or ingest, identify, score, and keep the result in a folder.

    Example: whid run study.yaml --set plant.noise.std=0.1
    """
    from whid.cli._gate import tell

    with Steps(quiet) as steps:
        from whid import flow  # takes a second: numpy, scipy, h5py
        from whid.config.memory import size

        result = flow.run(config, out, overrides, force=force, max_memory=size(max_memory), watch=steps)
    report(result, as_json, steps.seconds, quiet)
    tell(
        result.name,
        result.checks,
        [table for table in result.tables if table.title == "Fit"],
        result.exit_code,
        summary,
        junit,
    )
    return result.exit_code


def report(result: Any, as_json: bool, seconds: float | None = None, quiet: bool = False) -> None:
    """Print a result's tables, one JSON object, or its folder; the fault of an incomplete run goes to stderr."""
    from whid.cli._print import print_json, print_tables
    from whid.summary import expected

    if as_json:
        print_json(_object(result, seconds))
    elif quiet:
        click.echo(str(result.path))
        for metric, bound, value, verdict in expected(result.checks, tuple(result.metrics)).rows:
            if verdict != "pass":
                click.echo(
                    f"{verdict}: {metric} {bound}" + (f", it is {value:.6g}" if isinstance(value, float) else ""), err=True
                )
    else:
        print_tables(*result.tables)
        print(f"\n{'reused, nothing was run: ' if result.reused else ''}{result.path}")
        print("  " + "  ".join(["result.h5", "summary.md", *result.pictures]))
    if result.error:
        click.echo(f"error[{result.error.code}]: in {result.error.during}: {result.error.message}", err=True)
        click.echo(f"try: {result.error.explanation.remedy}", err=True)


def _object(result: Any, seconds: float | None) -> dict[str, Any]:
    from whid.quantity import Measured

    metrics = {name: m if isinstance(m, Measured) else Measured(m, float("nan")) for name, m in result.metrics.items()}
    return {
        "name": result.name,
        "path": str(result.path),
        "reused": result.reused,
        "metrics": metrics,
        "expect": [check._asdict() | {"verdict": check.verdict} for check in result.checks],
        "warnings": result.warnings,
        "error": result.error._asdict() if result.error else None,
        "tables": result.tables,
        "pictures": result.pictures,
        "seconds": seconds,
        "exit_code": result.exit_code,
    }
