"""Say what the declared model lacks, add it, and report the error before and after."""

from __future__ import annotations

from pathlib import Path

import click

from whid.cli._steps import Steps


@click.command()
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help="Where run folders go."
)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a value, e.g. trace.rounds=1.")
@click.option("--force", is_flag=True, help="Trace again into a sibling folder, even when this was done.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
@click.option("--max-memory", metavar="SIZE", default="4GB", show_default=True, help="Refuse a study that would need more.")
def command(config: Path, out: Path, overrides: tuple[str, ...], force: bool, as_json: bool, max_memory: str) -> int:
    """Say what the declared model lacks: find it in the residual, add it, and report the error before and after.

    Example: whid trace study.yaml --json
    """
    with Steps() as steps:
        from whid import flow
        from whid.config.memory import size

        result = flow.trace(config, out, overrides, force=force, max_memory=size(max_memory), watch=steps)
    if as_json and "verdict" in result.stages:
        from whid.cli._print import print_json
        from whid.trace import as_object

        refined = None if result.path is None else str(result.path / "refined.yaml")
        print_json(as_object(result.stages["verdict"]) | {"refined": refined})
    else:
        from whid.cli.run import report

        report(result, as_json, steps.seconds)
        if result.path is not None and "verdict" in result.stages:
            click.echo(f"  refined study: {result.path / 'refined.yaml'}")
            click.echo(result.stages["verdict"].sentence)
    return result.exit_code
