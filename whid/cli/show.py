"""Show the summary of a run again."""

from __future__ import annotations

from pathlib import Path

import click

from whid.cli.run import report


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def command(run: Path, as_json: bool) -> int:
    """Show the summary of a run again.

    Example: whid show runs/starter-0123456789
    """
    from whid import flow

    report(flow.load(run), as_json)
    return 0
