"""Write the experiments that a run asked for as a plan to take to the rig."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Write a new YAML file instead of printing it.")
def command(run: Path, out: Path | None) -> None:
    """Write the experiments that RUN asked for, with the reason and the standard error each one predicts.

    The parts are those of `experiment: parts:`; measure them, add the record to the study, run again.

    Example: whid next runs/bench-0123456789 --out plan.yaml
    """
    from whid import flow
    from whid.config.next_plan import next_plan
    from whid.files.text import write_new

    text = next_plan(flow.load(run))
    if out is None:
        click.echo(text, nl=False)
        return
    write_new(out, text)
    click.echo(str(out))
