"""Compare two runs or two sweeps: config, metrics, models; exit 1 where they differ."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from whid.compare import Difference, Tolerance

DIFFERS = 1


@click.command()
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@click.option("--rtol", type=click.FloatRange(min=0), default=1e-9, show_default=True, help="Relative tolerance.")
@click.option("--sigma", type=click.FloatRange(min=0), default=0.0, help="Equal within so many common standard errors.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def command(a: Path, b: Path, rtol: float, sigma: float, as_json: bool) -> int:
    """Compare two runs, or two sweeps: config by key, metrics, models whatever their scaling. Exit 0 or 1, like diff.

    Example: whid diff runs/starter-0123456789 runs/starter-0123456789.2 --sigma 2
    """
    from whid.cli._print import print_json, print_tables
    from whid.compare import Tolerance
    from whid.quantity import Table

    found = _sides(a, b, Tolerance(rtol, sigma))
    tables = [Table(title, ("what", "A", "B"), tuple(map(_row, rows))) for title, rows in found.items() if rows]
    if as_json:
        print_json({"differs": bool(tables), "tables": tables})
    elif tables:
        print_tables(*tables)
    else:
        click.echo("no difference")
    return DIFFERS if tables else 0


def _sides(a: Path, b: Path, tolerance: Tolerance) -> dict[str, list[Difference]]:
    from whid import compare
    from whid.errors import WhidError

    sweeps = [(path / "sweep.h5").is_file() for path in (a, b)]
    if len(set(sweeps)) > 1:
        raise WhidError("run-not-found", "one is a sweep, the other is not", f"{a}, {b}")
    configs = list(compare.settings(_config(a), _config(b)))
    if sweeps[0]:
        from whid import sweep

        cells = list(compare.numbers(_cells(sweep.load(a)), _cells(sweep.load(b)), tolerance))
        return {"Config": configs, "Cells": cells}
    from whid import flow

    x, y = flow.load(a), flow.load(b)
    both = "model" in x.stages and "model" in y.stages and x.records
    apart = list(compare.models(x.model.system, y.model.system, x.records[0], tolerance)) if both else []
    return {"Config": configs, "Metrics": list(compare.numbers(x.metrics, y.metrics, tolerance)), "Model": apart}


def _config(path: Path) -> Any:
    from whid.config.yaml import parse
    from whid.errors import WhidError
    from whid.files.text import read_text

    folder = path if path.is_dir() else path.parent
    if not (folder / "config.yaml").is_file():
        raise WhidError("run-not-found", "no config.yaml here", str(path))
    return parse(read_text(folder / "config.yaml")).value


def _cells(found: Any) -> dict[str, Any]:
    """Return the mean of every metric in every cell, with its error."""
    table = found.table(list(found.values))
    places = len(found.over)
    return {" ".join(map(str, row[: places + 1])): row[places + 1] for row in table.rows}


def _row(each: Difference) -> tuple[Any, ...]:
    from whid.quantity import Measured

    plain = (Measured, int, float, str, type(None))
    return (each.what, *(x if isinstance(x, plain) else str(x) for x in each[1:]))
