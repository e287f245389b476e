"""Show the summary of a run or a sweep again."""

from __future__ import annotations

from pathlib import Path

import click

from whid.cli.run import report


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def command(run: Path, as_json: bool) -> int:
    """Show the summary of a run or a sweep again.

    Example: whid show runs/starter-0123456789
    """
    if (run / "sweep.h5").is_file():
        from whid.cli.sweep import report as report_sweep
        from whid.sweep import load

        report_sweep(load(run), as_json)
        return 0
    from whid import flow

    report(flow.load(run), as_json)
    return 0
