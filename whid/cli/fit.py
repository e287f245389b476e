"""Fit the declared model to the data of a study, and nothing else; show the cost of every iteration."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import click

from whid.cli._steps import Steps
from whid.cli.run import report


@click.command()
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("runs"), show_default=True, help="Where run folders go."
)
@click.option(
    "--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a value, e.g. model.chain[0].fix=true."
)
@click.option("--noise", type=click.Choice(["white", "ar"]), default="white", show_default=True, help="Noise model.")
@click.option("--robust", is_flag=True, help="Huber's loss: single wild samples count less.")
@click.option("--starts", type=click.IntRange(min=1), default=1, show_default=True, help="Fits from scattered starts.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def command(
    config: Path, out: Path, overrides: tuple[str, ...], noise: str, robust: bool, starts: int, as_json: bool
) -> int:
    """Fit the declared model to the data of a study, and nothing else; Ctrl-C keeps the best so far.

    Example: whid fit study.yaml --noise ar
    """
    with Steps() as steps:
        from whid import flow
        from whid.config.load import load_study
        from whid.methods.fit import Fit

        @dataclass(frozen=True, kw_only=True)
        class Shown(Fit):
            def told(self, iteration: int, cost: float) -> None:
                print(f"  iteration {iteration:3d}   cost per sample {cost:.8g}   {steps.seconds:.1f} s", file=sys.stderr)

        study = load_study(config, overrides)
        sampled = any(experiment.path == "sampled" for experiment in study.experiment)
        method = Shown(noise=noise, robust=robust, starts=starts, path="sampled" if sampled else "exact")  # type: ignore[arg-type]
        result = flow.run(replace(study, identify=method), out, base=config.parent, force=True, watch=steps)
    report(result, as_json, steps.seconds)
    return result.exit_code
