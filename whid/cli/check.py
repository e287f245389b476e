"""Check a config: every fault with its line, or what the study is."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import click

from whid.errors import Faults, WhidError


@click.command()
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a value, e.g. plant.noise.std=0.1.")
@click.option("--max-memory", metavar="SIZE", default="4GB", show_default=True, help="Refuse a study that needs more.")
@click.option("--json", "as_json", is_flag=True, help="Print the overview as JSON.")
def command(config: Path, overrides: tuple[str, ...], max_memory: str, as_json: bool) -> None:
    """Check CONFIG and say in a few lines what it declares; nothing is run.

    Of data files the columns are looked for; what is in the rows comes to light when it is run.

    Exit code 2 with every fault as file:line:col: path: what is wrong, what is allowed.

    Example: whid check study.yaml --set plant.noise.std=0.1
    """
    from whid.cli._print import print_json, print_tables
    from whid.config.load import load_study
    from whid.config.memory import allow, size
    from whid.config.overview import overview
    from whid.files.ingest import check_columns

    study = load_study(config, overrides)
    tests: list[Callable[[], object]] = [lambda: allow(study, size(max_memory), config.parent)]
    tests += [partial(check_columns, source, config.parent) for source in study.sources]
    for path, values in (study.sweep.over if study.sweep else {}).items():
        tests += [partial(_swept, config, overrides, path, value) for value in values]
    if faults := [fault for test in tests for fault in _faults(test)]:
        raise Faults(list({str(fault): fault for fault in faults}.values()))  # every value of a sweep may have the same
    table = overview(study, config.parent)
    if as_json:
        print_json(table)
    else:
        print_tables(table)


def _swept(config: Path, overrides: Sequence[str], path: str, value: object) -> None:
    """Load the study of one value of a sweep; a fault of it stands in `sweep: over:`, not on the command line."""
    from whid.config.load import load_study

    try:
        load_study(config, [*overrides, f"{path}={json.dumps(value)}"])
    except WhidError as error:
        found = error.faults if isinstance(error, Faults) else (error,)
        place = f"--set {path}"
        raise Faults(
            [
                WhidError(
                    f.code,
                    f.message,
                    f"{config}: sweep.over: {path}{f.where.removeprefix(place)}" if f.where.startswith(place) else f.where,
                )
                for f in found
            ]
        ) from None


def _faults(test: Callable[[], object]) -> Sequence[WhidError]:
    """Return what a test raises."""
    try:
        test()
    except Faults as error:
        return error.faults
    except WhidError as error:
        return (error,)
    return ()
