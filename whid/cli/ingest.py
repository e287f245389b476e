"""Show what a data file holds: columns, time, levels and sines found, and a study to start from."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from whid.experiments._part import Part
    from whid.files.ingest import Ingested
    from whid.files.source import DataSource
    from whid.quantity import Table

ROLES = ("time", "input", "output")
SHOWN = 30  # columns, parts other than levels


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--columns", metavar="ROLE=NAME,…", default="", help="e.g. time=t,input=u,output=y; numbers count from 0.")
@click.option("--dt", type=click.FloatRange(min=0, min_open=True), help="Sampling time in s, where there is no time column.")
@click.option("--missing", type=click.Choice(["error", "mask", "interpolate"]), default="error", show_default=True)
@click.option("--resample", is_flag=True, help="Put samples of uneven times on a uniform grid first.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="The picture; FILE's name with -ingest.png, here, unless given."
)
@click.option("--json", "as_json", is_flag=True, help="Print what was found as JSON; a picture only with --out.")
def command(
    file: Path, columns: str, dt: float | None, missing: Any, resample: bool, out: Path | None, as_json: bool
) -> None:
    """Show what FILE holds and how whid understands it; FILE is a data file, or a config whose records to show.

    Prints columns, sampling, the levels and sines found in the input, what was noticed, and a study to save and run; draws
    the record with its parts.

    Example: whid ingest bench.csv --columns time=t,input=u,output=y
    """
    from whid.cli._print import print_json, print_tables
    from whid.files.ingest import ingest
    from whid.files.source import DataSource

    if file.suffix.lower() in (".yaml", ".yml"):
        from whid.config.load import load_study

        sources, base = load_study(file).sources, file.parent
    else:
        from whid.operations.resample import Resample

        first = (Resample(input="hold"),) if resample else ()  # zoh: what a new source is taken for
        source = DataSource(file=str(file), columns=_columns(columns), dt=dt, missing=missing, operations=first,
                            parts="auto", name=_stem(file))  # fmt: skip
        sources, base = (source,), Path()
    shown = []
    for source in sources:
        columns_found = _columns_table(source, base)
        if not as_json:
            print_tables(columns_found)  # first: a fault about columns is easier to mend when one sees them
        found = ingest(source, base)
        tables = [columns_found, _record_table(source, found), *_parts_tables(found)]
        shown.append({"name": source.name, "sha256": found.sha256, "tables": tables, "notes": found.notes,
                      "parts": _plain(found.record.parts), "data": _plain(_declared(source, found, base))})  # fmt: skip
        picture = out or Path(f"{_stem(file)}-ingest.png" if len(sources) == 1 else f"{source.name}-ingest.png")
        if out or not as_json:
            drawn = _draw(found, picture, out is not None)
        if not as_json:
            click.echo()
            print_tables(*tables[1:])
            click.echo("".join(f"note: {note}\n" for note in found.notes) + f"{drawn}\n")
            click.echo(_study(source, found, base))
    if as_json:
        print_json(shown if len(shown) > 1 else shown[0])


def _columns(text: str) -> Any:
    from whid.files.source import Columns

    pairs = dict(pair.partition("=")[::2] for pair in re.split(r",(?=\s*\w+\s*=)", text) if pair.strip())
    given = {role.strip(): name.strip() for role, name in pairs.items()}
    if wrong := [role for role in given if role not in ROLES or not given[role]]:
        raise click.BadParameter(f"{wrong[0]!r}: write time=…,input=…,output=…", param_hint="--columns")
    return Columns(**{role: int(name) if name.isdigit() else name for role, name in given.items()})


def _stem(file: Path) -> str:
    return file.name.removesuffix(".gz").rpartition(".")[0] or file.name


def _columns_table(source: DataSource, base: Path) -> Table:
    """Return what is in the file, before anything is believed about it."""
    import numpy as np

    from whid.errors import WhidError
    from whid.files.ingest import opened
    from whid.quantity import Table

    table = opened(source, base)
    rows: list[tuple[Any, ...]] = []
    for k, name in enumerate(table.names[:SHOWN]):
        try:
            x = table.load([k])[0]
        except WhidError as fault:
            if fault.code != "data-cell":
                raise
            rows.append((k, name, table.units.get(name, ""), "", None, None, str(fault)))
            continue
        known = x[np.isfinite(x)]
        ends = _ends(float(known.min()), float(known.max())) if len(known) else (None, None)
        missing = f"{len(x) - len(known)} missing" if len(known) < len(x) else ""
        rows.append((k, name, table.units.get(name, ""), len(x), *ends, missing))
    rows += [("", name, "", 1, value, value, "a single number") for name, value in list(table.scalars.items())[:SHOWN]]
    return Table(f"{Path(source.file).name}", ("column", "name", "unit", "samples", "lowest", "highest", ""), tuple(rows))


def _ends(low: float, high: float) -> tuple[float, float]:
    """Return the ends of a column; whole numbers that are close to each other with all their digits: Unix seconds."""
    close = high - low < 1e-3 * abs(high) and low == round(low) and high == round(high)
    return (int(low), int(high)) if close else (low, high)


def _record_table(source: DataSource, found: Ingested) -> Table:
    from whid.quantity import Table, moment
    from whid.stages._holds import least_bit
    from whid.stages.causality import causality
    from whid.stages.intersample import intersample
    from whid.tables import in_units

    record = found.record
    y = record.y[record.mask]
    whole = len(y) == len(record)
    between = intersample(record.u, record.y, source.intersample) if whole else None
    order = causality(record.u, record.y) if whole else None
    rows: list[tuple[Any, ...]] = [
        ("samples", len(record), "" if whole else f"{len(record) - len(y)} outputs missing"),
        ("sampling time, s", record.dt, f"{1 / record.dt:.6g} Hz"),
        ("duration, s", len(record) * record.dt, f"from {moment(record.t0)}"),
        (in_units("input, input", record.units), None, _range(record.u, least_bit(record.u))),
        (in_units("output, output", record.units), None, _range(y, least_bit(y))),
    ]
    if between and order:
        rows += [
            (f"intersample: {source.intersample}", None, f"{between.verdict}: {between.reason}"),
            ("input before output", None, order.verdict if source.causal else "not asked (causal: false)"),
        ]
    return Table(f"record {record.name}", ("what", "value", "remark"), tuple(rows))


def _range(x: Any, bit: float) -> str:
    return f"{x.min():.6g} … {x.max():.6g}" + (f", in steps of {bit:.4g}" if bit else "")


def _parts_tables(found: Ingested) -> list[Table]:
    """Return the levels in one row, every other part in its own."""
    from whid.plots.ingest import summary
    from whid.quantity import Table

    record = found.record
    levels = [part for part in record.parts if part.kind == "hold"]
    rows: list[tuple[Any, ...]] = []
    if levels:
        values, lengths = [part.level for part in levels], [part.length for part in levels]  # type: ignore[attr-defined]
        text = f"{len(set(values))} different, {_span(values)}; each {_span([n * record.dt for n in lengths])} s"
        rows.append((summary(levels), levels[0].start, levels[-1].stop, text, levels[0].use))
    others = [part for part in record.parts if part.kind != "hold"]
    rows += [(part.kind, part.start, part.stop, _words(part, record.dt), part.use) for part in others[:SHOWN]]
    notes = (f"and {len(others) - SHOWN} more",) if len(others) > SHOWN else ()
    return [Table("parts", ("part", "start", "stop", "what", "use"), tuple(rows), notes)] if rows else []


def _words(part: Part, dt: float) -> str:
    """Return a part's fields as people read them: four digits, and the period in samples and in seconds."""
    keys = {k: v for k, v in _plain(part).items() if k not in ("kind", "start", "stop", "use")}
    words = {k: f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in keys.items()}
    if isinstance(period := keys.get("period"), (int, float)):
        words["period"] = f"period {period:.7g} samples ({period * dt:.4g} s)"
    if "phase" in words:
        words["phase"] = f"phase {round(keys['phase'], 4) + 0.0:.4g} rad"
    return ", ".join(words.values())


def _span(values: list[float]) -> str:
    low, high = f"{min(values):.4g}", f"{max(values):.4g}"
    return low if low == high else f"{low} … {high}"


def _plain(value: Any) -> Any:
    from whid.kinds import plain

    return plain(value)


def _declared(source: DataSource, found: Ingested, base: Path) -> DataSource:
    """Return the source with everything that was guessed written out."""
    from dataclasses import replace

    from whid.files.ingest import choose, opened
    from whid.files.source import Columns

    table = opened(source, base)
    chosen, _ = choose(source, table)
    names = {role: (table.names[k] if table.named else k) for role, k in chosen._asdict().items() if k is not None}
    timed = "time" in names or source.rate_hz
    units: Any = source.units | {role: unit for role, unit in found.record.units.items() if unit != "1"}
    return replace(source, columns=Columns(**names), units=units, dt=None if timed else found.record.dt)


def _study(source: DataSource, found: Ingested, base: Path) -> str:
    """Return a study that runs as it is, the beliefs that most often need a second thought spelled out.

    Without levels the method is the one for any excitation.
    """
    from whid.config.yaml import dump

    declared = _plain(_declared(source, found, base))
    spelled = {"intersample": source.intersample, "initial": found.record.initial, "missing": source.missing}
    order = ("name", "file", "columns", "dt", "units", "operations", *spelled, "parts", "use")
    both = {k: v for k, v in {**declared, **spelled}.items() if k != "name"}
    ordered = {k: both[k] for k in order if k in both} | {k: v for k, v in both.items() if k not in order}
    plain_letters = unicodedata.normalize("NFKD", source.name.replace("ß", "ss")).encode("ascii", "ignore").decode()
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", plain_letters).strip("-._")[:64] or "study"
    said = f"# save as {name}.yaml, then: whid check {name}.yaml, whid run {name}.yaml\n"
    levels = sum(part.kind == "hold" for part in found.record.parts)
    method = "wiener_hammerstein" if levels > 1 else "parametric"
    return said + dump({"name": name, "data": ordered, "identify": {"kind": method}})


def _draw(found: Ingested, picture: Path, wanted: bool) -> str:
    """Draw the record and say where; a picture that nobody asked for and that cannot be written costs a note."""
    from whid.errors import WhidError
    from whid.plots import ingest as drawing
    from whid.plots._style import save

    try:
        save(drawing.draw, found.record, picture)
    except OSError as fault:
        if not wanted:
            return f"no picture: {picture}: {fault.strerror}; give another place with --out"
        raise WhidError("data-picture", f"cannot write the picture: {fault.strerror}", str(picture)) from fault
    return f"picture: {picture}"
