"""The summary of a run as Tables: study, stages, model, fit, what was asked for, what was expected, what is in doubt."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.kinds import plain
from whid.quantity import Cell, Measured, Table
from whid.record import Record
from whid.result import Check, Result, at_frequency
from whid.tables import in_units, markdown

USES = ("estimation", "selection", "report")
NAMES = "a name is a path, counted from 0: chain.1.pieces.0.2 is block 1, piece 0, u²; num and den fall in powers of s"
IN_SAMPLE = "no report part: these errors are in sample, not evidence"


def tables(result: Result) -> tuple[Table, ...]:
    """Return the tables of a summary; a stage adds its own by a method `table() -> Table`."""
    units = _units(result.records)
    return tuple(_in_units(table, units) for table in _all(result) if table.rows or table.notes)


def _units(records: Sequence[Record]) -> dict[str, str]:
    """Return the unit of input and output, "1" where records differ."""
    found = {role: {record.units.get(role, "1") for record in records} for role in ("input", "output")}
    return {role: units.pop() if len(units) == 1 else "1" for role, units in found.items()}


def _in_units(table: Table, units: Mapping[str, str]) -> Table:
    """Return a table whose headings `mean, output` name the record's unit, or none where it has none."""
    return table._replace(columns=tuple(in_units(text, units) for text in table.columns))


def page(result: Result) -> str:
    """Return summary.md."""
    status, why = "", result.error
    if why:
        status = f"**incomplete** ({why.code}): {why.message} (in {why.during}). Try: {why.explanation.remedy}\n\n"
    pictures = "".join(f"\n![{name}]({name})\n" for name in result.pictures)
    body = "\n\n".join(markdown(table) for table in result.tables)
    return f"# {result.name}\n\n{status}{body}\n{pictures}"


def _all(result: Result) -> Iterator[Table]:
    yield _study(result)
    for name, stage in result.stages.items():
        if hasattr(stage, "table") and not re.search(r"_\d+$", name):
            yield _together([each.table() for each in result.every(name)])
    if "model" in result.stages:
        yield _model(result)
    yield _fit(result)
    yield _metrics(result)
    yield _compared(result)
    yield _asked(result)
    yield expected(result.checks, tuple(result.metrics))
    if result.warnings:
        yield Table("Warnings", ("warning",), tuple((text,) for text in result.warnings))


def _together(tables: list[Table]) -> Table:
    """Return the tables of a stage's repetitions as one, numbered where they are several."""
    if len(tables) == 1:
        return tables[0]
    rows = tuple((number, *row) for number, table in enumerate(tables, 1) for row in table.rows)
    notes = [note for table in tables for note in table.notes]
    numbered = [f"{n}: {note}" for n, table in enumerate(tables, 1) for note in table.notes]
    return Table(tables[0].title, ("no.", *tables[0].columns), rows, tuple(numbered if len(set(notes)) > 1 else notes[:1]))


def _compared(result: Result) -> Table:
    """Return the metrics `paper.<name>` beside `<name>`: the paper's own estimate, the efficient one, and what was printed.

    Printed numbers of which none is a metric of one run (a variance over many) have their place in `whid table` only.
    """
    if result.published is None:
        return Table("", (), ())
    printed = {name: (truth, value) for name, value, truth in result.published}
    printed = printed if printed.keys() & result.metrics.keys() else {}
    paper = {name.removeprefix("paper."): value for name, value in result.metrics.items() if name.startswith("paper.")}
    names = list(dict.fromkeys([*printed, *paper]))
    rows = [(*printed.get(n, (None, None)), paper.get(n), result.metrics.get(n, "not observed")) for n in names]
    headings = ("published truth", "published", "paper's method, ours", "efficient, ours")
    shown = [k for k in range(4) if any(row[k] is not None for row in rows)]
    report = result.stages.get("identifiability")
    return Table(
        "The paper's method and the efficient one", ("quantity", *(headings[k] for k in shown)),
        tuple((name, *(row[k] for k in shown)) for name, row in zip(names, rows, strict=True)),
        tuple(getattr(report, "not_measured", ())) if names else ("no stage of this run gives a paper's own estimate",),
    )  # fmt: skip


def _study(result: Result) -> Table:
    origin = result.provenance
    simulated = result.truth is not None
    source = (
        f"simulated, {origin['path']} path, seed {origin['seed']}" if simulated else "measured: " + ", ".join(origin["data"])
    )
    rows: list[tuple[Cell, ...]] = [("data", source), ("method", origin["method"])]
    if result.truth is not None:
        noise = "; ".join(_words(plain(noise)) for noise in result.truth.noise)
        rows.append(("noise", noise or "none"))
    rows += [("record" if r.name == "record" else f"record {r.name}", _record(r)) for r in result.records]
    return Table(f"Study {result.name}", ("what", "value"), tuple(rows), tuple(origin.get("notes", ())))


def _record(record: Record) -> str:
    units = f"input {record.units.get('input', '1')}, output {record.units.get('output', '1')}, "
    was = getattr(record, "was", record.parts)
    parts = Counter(part.kind + ("" if part.use == "estimation" else f" ({part.use})") for part in was)
    missing = int(np.sum(~record.mask))
    every = getattr(record, "every", 1)
    whole = f"{len(record)} samples" if every == 1 else f"{record.samples} samples in chunks, every {every}th kept"  # type: ignore[attr-defined]
    return (
        f"{whole}, dt {record.dt / every:.6g} s, {units if set(record.units.values()) != {'1'} else ''}"
        f"{record.intersample}, {record.initial}"
        + (": " + ", ".join(f"{count} {kind}" for kind, count in parts.items()) if parts else "")
        + (f"; {missing} missing" if missing else "")
    )


def _words(mapping: dict[str, Any]) -> str:
    """Return a mapping as people say it: `white, std 0.5`."""
    kind, *rest = mapping.items()
    return ", ".join([str(kind[1]), *(f"{key} {value}" for key, value in rest)])


def _model(result: Result) -> Table:
    """Return every parameter with its standard error, and the truth where the structures agree."""
    model = result.stages["model"]
    estimate = model.estimate
    truth = _true_values(result, estimate.names)
    rows = [
        (name, Measured(float(value), float(std)), *((truth[name],) if truth else ()))
        for name, value, std in zip(estimate.names, estimate.values, estimate.std, strict=True)
    ]
    every = {p.name: p.value for p in model.system.tree.parameters()}
    known = every.keys() >= set(estimate.names)
    held = [(name, value) for name, value in every.items() if known and name not in estimate.names]
    rows += [(*row, *((None,) if truth else ())) for row in held]
    chain = " → ".join(block.kind for block in model.system.chain)
    fit = f"{chain}; normalisation {model.normalisation}; χ²/dof {_ratio(estimate)}, stopped: {estimate.why_stop}"
    columns = ("parameter", "estimate", *(("truth",) if truth else ()))
    rows.sort(key=lambda row: [int(x) if x.isdecimal() else x for x in row[0].split(".")])
    said = (f"held, to fix a scale: {', '.join(name for name, _ in held)}",) if held else ()
    return Table("Model", columns, tuple(rows), (NAMES, fit, *said, *(f"not known: {what}" for what in model.missing)))


def _ratio(estimate: Any) -> str:
    return f"{estimate.chi2 / estimate.dof:.3g}, {estimate.dof} dof" if estimate.dof > 0 else "undefined (0 dof)"


def _true_values(result: Result, names: tuple[str, ...]) -> dict[str, float | None]:
    """Return the truth by parameter name, nothing unless plant and model share the blocks and their static gains."""
    if result.truth is None or [b.kind for b in result.truth.chain] != [b.kind for b in result.model.system.chain]:
        return {}
    found: dict[str, float | None] = {}
    for place, (true, model) in enumerate(zip(result.truth.chain, result.model.system.chain, strict=True)):
        if isinstance(true, Polynomial) and isinstance(model, Polynomial):
            true = true.like(model)
        values = _values(true)
        if isinstance(true, Linear) and isinstance(model, Linear):
            if abs(_static_gain(true) / _static_gain(model) - 1) > 1e-6:
                return {}
            values = _scaled_alike(values, _values(model))
        alike = values.keys() == _values(model).keys()
        found |= {f"chain.{place}.{name}": value for name, value in values.items()} if alike else {}
    return {name: found.get(name) for name in names} if found else {}


def _static_gain(block: Linear) -> complex:
    return complex(block.gain_at(np.zeros(1))[0])


def _values(block: Any) -> dict[str, float]:
    return {parameter.name: parameter.value for parameter in block.parameters(held=True)}


def _scaled_alike(true: dict[str, float], model: dict[str, float]) -> dict[str, float]:
    """Return num and den of the truth over a common factor, the one that makes the last of den the model's."""
    last = max((name for name in true if name.startswith("den.")), key=lambda name: int(name[4:]), default="")
    factor = model.get(last, 0.0) / true[last] if last and true[last] else 1.0
    return {name: value * (factor or 1.0) if name[:4] in ("num.", "den.") else value for name, value in true.items()}


def _fit(result: Result) -> Table:
    """Return the metrics called `<use>.<what>`, a row a use."""
    found = {name: value for name, value in result.metrics.items() if name.split(".")[0] in USES}
    whats = tuple(dict.fromkeys(name.split(".", 1)[1] for name in found))
    uses = [use for use in USES if any(name.startswith(f"{use}.") for name in found)]
    rows = tuple((use, *(found.get(f"{use}.{what}") for what in whats)) for use in uses)
    headings = {"rms": "rms, output", "fit": "fit, %"}
    return Table(
        "Fit",
        ("on", *(headings.get(what, what) for what in whats)),
        rows,
        (IN_SAMPLE,) if rows and "report" not in uses else (),
    )


def _metrics(result: Result) -> Table:
    single = [name for name in result.metrics if at_frequency(name)]
    told = {*USES, "verdict"}  # in tables of their own
    shown = {name: m for name, m in result.metrics.items() if name.split(".")[0] not in told and not at_frequency(name)}
    notes = (
        (f"{len(single)} gains and phases at single frequencies, such as `{single[0]}`: in result.h5, --json",)
        if single
        else ()
    )
    return Table("Metrics", ("metric", "value"), tuple(shown.items()), notes)


def _asked(result: Result) -> Table:
    """Return every experiment that the method asked for: why, what it was to tell, and what came of it."""
    rows = []
    for k, asked in enumerate(result.asked, 1):
        counts = Counter(str(part["kind"]) for part in asked.plan)
        plan = ", ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in counts.items())
        told = f"not performed: {asked.refused}" if asked.refused else asked.answer or "performed"
        predicted = f"{asked.predicted_se:.2g}{f' of {asked.of}' * bool(asked.of)}"
        rows.append((k, asked.reason, f"{plan}, {asked.samples} samples", predicted, told))
    columns = ("no.", "reason", "experiment", "predicted standard error", "what it told")
    note = ("`whid next RUN` writes what was not performed as a plan",) if any(a.refused for a in result.asked) else ()
    return Table("Experiments asked for", columns, tuple(rows), note)


def expected(checks: Sequence[Check], metrics: Sequence[str] = ()) -> Table:
    """Return the bounds and their verdicts; of a metric that is none, the name that is nearest."""
    rows = tuple((_judged(check), _bound(check), check.value, check.verdict) for check in checks)
    absent = [check.metric for check in checks if metrics and check.metric not in metrics]
    near = {name: difflib.get_close_matches(name, metrics, n=1) for name in absent}
    notes = tuple(f"{name}: no metric of this run" + (f"; did you mean {n[0]}?" if n else "") for name, n in near.items())
    return Table("Expected", ("metric", "bound", "value", "verdict"), rows, notes)


def _judged(check: Check) -> str:
    return f"{check.metric}, {check.of}" if check.of else check.metric


def _bound(check: Any) -> str:
    bounds = (("above", check.above), ("below", check.below))
    return " and ".join(f"{side} {limit:g}" for side, limit in bounds if limit is not None)
