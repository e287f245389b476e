"""Apply the model of a run to a new record: prediction, its standard error, and the score where y is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from whid.files.source import DataSource
    from whid.record import Record
    from whid.result import Result

ROLES = ("time", "input", "output")


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--data", "file", required=True, metavar="FILE", help="The new record: .csv, .npz, .mat, .h5, …")
@click.option(
    "--columns", metavar="time=t,input=u,output=y", help="Columns by name or number; left out: as the run's own data."
)
@click.option(
    "--dt", type=click.FloatRange(min=0, min_open=True), help="Sampling time, s, where the file has no time column."
)
@click.option("--initial", type=click.Choice(["steady", "rest", "free"]), help="State before the first sample.")
@click.option("--out", type=click.Path(path_type=Path), help="CSV to write: t, u, y, y_hat, y_hat_std.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
def command(
    run: Path, file: str, columns: str | None, dt: float | None, initial: Any, out: Path | None, as_json: bool
) -> None:
    """Apply the model of a run to a new record: prediction, its standard error, and the score where y is there.

    Example: whid predict runs/starter-0123456789 --data new.csv --out pred.csv
    """
    import numpy as np

    from whid import flow
    from whid.cli._print import print_json, print_tables
    from whid.files.ingest import ingest
    from whid.files.text import write_new
    from whid.predict import predict
    from whid.quantity import Table
    from whid.refine import band
    from whid.residual import misfit_of
    from whid.score import score

    result = flow.load(run)
    path = "sampled" if result.provenance.get("path") == "sampled" else "exact"
    record = ingest(_source(result, file, columns, dt, initial), Path(), alone=True).record
    record = replace(record, initial="steady" if record.initial == "free" and not record.mask.any() else record.initial)
    tree = result.model.system.tree
    y_hat, std = predict(tree, record, path), band(tree, record, result.model.estimate, path)
    metrics: dict[str, Any] = {"samples": len(record), "y_hat_std.max": float(std.max(initial=0.0))}
    if record.mask.any():
        metrics |= score(result.model, [record], [misfit_of(record, np.where(record.mask, record.y - y_hat, np.nan))])
    if out is not None:
        write_new(out, _csv(record, y_hat, std))
    if as_json:
        print_json(metrics | ({"out": str(out)} if out else {}))
        return
    rows = tuple((name, value) for name, value in metrics.items())
    notes = (*_beyond(result, record), *((f"written: {out}",) if out else ()))
    print_tables(Table(f"{result.name} on {file}", ("metric", "value"), rows, notes))


def _beyond(result: Result, record: Record) -> tuple[str, ...]:
    """Return a note when the input leaves the range that the model was made in by more than a twentieth of it."""
    low, high = (float(end([end(known.u) for known in result.records])) for end in (min, max))
    span, (first, last) = high - low, (float(record.u.min()), float(record.u.max()))
    if first >= low - span / 20 and last <= high + span / 20:
        return ()
    return (f"extrapolated: the input goes from {first:.4g} to {last:.4g}, the model was made from {low:.4g} … {high:.4g}",)


def _source(result: Result, file: str, columns: str | None, dt: float | None, initial: Any) -> DataSource:
    """Return how the new file is read: as the run's own data where it was measured, else by what its model was made from."""
    from whid.config.load import study_of
    from whid.config.yaml import parse
    from whid.files.source import Columns, DataSource

    declared = study_of(parse(result.provenance["config"])).sources
    first = result.records[0]
    source = declared[0] if declared else DataSource(file=file, intersample=first.intersample, initial=first.initial)
    source = replace(source, file=file, parts=(), use="report", name="new")
    if columns:
        source = replace(source, columns=Columns(**_columns(columns)))
    if dt is not None:
        source = replace(source, dt=dt, rate_hz=None)
    return replace(source, initial=initial) if initial else source


def _columns(text: str) -> dict[str, str | int]:
    from whid.errors import WhidError

    found: dict[str, str | int] = {}
    for item in text.split(","):
        role, _, name = (part.strip() for part in item.partition("="))
        if role not in ROLES or not name:
            raise WhidError("data-column", f"--columns is written time=…,input=…,output=…, not {item.strip()!r}")
        found[role] = int(name) if name.isdigit() else name
    return found


def _csv(record: Record, y_hat: Any, std: Any) -> str:
    import numpy as np

    y = np.where(record.mask, record.y, np.nan)
    rows = zip(record.time, record.u, y, y_hat, std, strict=True)
    return "t,u,y,y_hat,y_hat_std\n" + "".join(
        f"{t:.12g},{u:.12g},{'' if np.isnan(v) else format(v, '.12g')},{p:.12g},{s:.6g}\n" for t, u, v, p, s in rows
    )
