"""Check a config: every fault with its line, or what the study is."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a value, e.g. plant.noise.std=0.1.")
@click.option("--max-memory", metavar="SIZE", default="4GB", show_default=True, help="Refuse a study that needs more.")
@click.option("--json", "as_json", is_flag=True, help="Print the overview as JSON.")
def command(config: Path, overrides: tuple[str, ...], max_memory: str, as_json: bool) -> None:
    """Check CONFIG and say in a few lines what it declares; nothing is run.

    Exit code 2 with every fault as file:line:col: path: what is wrong, what is allowed.

    Example: whid check study.yaml --set plant.noise.std=0.1
    """
    from whid.cli._print import print_json, print_tables
    from whid.config.load import load_study
    from whid.config.memory import allow, size
    from whid.config.overview import overview
    from whid.errors import Faults, WhidError
    from whid.files.source import locate

    study, faults = load_study(config, overrides), []
    for test in [lambda: allow(study, size(max_memory), config.parent)] + [
        lambda file=source.file: locate(file, config.parent) for source in study.sources
    ]:
        try:
            test()
        except WhidError as fault:
            faults.append(fault)
    if faults:
        raise Faults(faults)
    table = overview(study, config.parent)
    if as_json:
        print_json(table)
    else:
        print_tables(table)
