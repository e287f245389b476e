"""The result file: one HDF5 a run, for xarray, NeXus readers and h5glance alike.

/stages/<stage>    one group a stage, fields under their own names          /metrics      one number a metric
/records/<record>  time, u, y, valid, residual, parts                       /provenance   config, versions, seed, hashes
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.files._groups import PACKED, Units, array, attach, fields, get, put, units, write
from whid.files._new_hdf5 import new_hdf5
from whid.kinds import plain, yaml_key
from whid.quantity import Measured, Table
from whid.record import Record
from whid.result import Asked, Check, Failure, Result
from whid.signal import Floats
from whid.system import System

COLUMNS = 5  # of a record: time, u, y, valid, residual
BLOCK = 1 << 18  # samples written at a time
WORDS = ("name", "intersample", "initial", "use")  # of a record
KEPT = ("checks", "asked", "warnings", "error", "tables", "pictures", "published")  # of a result, as JSON
Tree = Callable[[Any], System]


def write_result(path: Path, result: Result, metric_units: Callable[[str], str] = lambda name: "1") -> None:
    """Write a result; numbers carry units, axes their scales, errors the name `<name>_errors`."""
    of = result.records[0].units if result.records else {}
    size = 8 * COLUMNS * sum(len(record) for record in result.records)
    with new_hdf5(path, size) as file:
        file.attrs.update({"NX_class": "NXroot", "name": result.name, "creator": "whid"})
        stages = file.create_group("stages", track_order=True)
        for name, stage in result.stages.items():
            write(stages, name, stage, of)
        _records(file.create_group("records", track_order=True), result)
        _metrics(file.create_group("metrics", track_order=True), result, metric_units, of)
        _provenance(file.create_group("provenance"), result)
        plotted = [name for name in stages if stages[name].attrs["NX_class"] == "NXdata"]
        stages.attrs["NX_class"] = "NXentry"
        if plotted:
            stages.attrs["default"] = plotted[0]
        file.attrs["default"] = "stages" if plotted else "records"


def read_result(path: Path, tree: Tree) -> Result:
    """Read a result back; raise `WhidError("result-unreadable")` for a file that is not one."""
    try:
        with h5py.File(path) as file:
            kept = json.loads(file["provenance/result"].asstr()[()])
            origin = fields(file["provenance"], tree)
            records, residuals = zip(*(_record(item) for item in file["records"].values()), strict=True)
            return Result(
                name=file.attrs["name"],
                records=records,
                stages={name: get(item, tree) for name, item in file["stages"].items()},
                residuals=tuple(r for r in residuals if r is not None),
                metrics={name: _number(item) for name, item in file["metrics"].items() if not name.endswith("_errors")},
                checks=tuple(Check(*row) for row in kept["checks"]),
                asked=tuple(Asked(*row)._replace(plan=tuple(row[3])) for row in kept["asked"]),
                warnings=tuple(kept["warnings"]),
                error=Failure(*kept["error"]) if kept["error"] else None,
                tables=tuple(_table(row) for row in kept["tables"]),
                pictures=tuple(kept["pictures"]),
                published=None if kept["published"] is None else tuple(map(tuple, kept["published"])),
                truth=origin.pop("truth", None),
                provenance=origin,
                path=path.parent,
            )
    except (OSError, KeyError, ValueError, TypeError, AttributeError) as fault:
        raise WhidError("result-unreadable", f"not a result of whid: {fault}", str(path)) from fault


def _records(group: h5py.Group, result: Result) -> None:
    group.attrs["NX_class"] = "NXentry"
    for k, record in enumerate(result.records):
        name = re.sub(r"\W", "_", record.name)
        name = f"{name}_{k + 1}" if name in group else name
        _write_record(group.create_group(name), record, result.residuals[k] if result.residuals else None)
    if len(group):
        group.attrs["default"] = next(iter(group))


def _write_record(group: h5py.Group, record: Record, residual: Floats | None) -> None:
    _time(group, record)
    signals = {
        "u": (record.u, "input"),
        "y": (record.y, "output"),
        "residual": (residual, "output"),
        "valid": (record.valid, ""),
    }
    for name, (values, unit) in signals.items():
        if values is not None:
            array(group, name, values, record.units.get(unit, "1")).dims[0].attach_scale(group["time"])
    for name in ("dt", "t0"):
        array(group, name, getattr(record, name), "s")
    group.attrs.update({name: getattr(record, name) for name in WORDS})
    group.attrs["title"] = f"record {record.name}"
    array(group, "parts", json.dumps([plain(part) for part in record.parts]), "")
    group.attrs.update({"NX_class": "NXdata", "signal": "y", "auxiliary_signals": ["u"], "axes": ["time"]})


def _time(group: h5py.Group, record: Record) -> None:
    """Write the time axis block by block: a long record has no room for another copy of itself."""
    n = len(record)
    packed = {"chunks": (min(n, BLOCK),), "compression": "gzip", "compression_opts": 1, "shuffle": True}
    time = group.create_dataset("time", (n,), float, **(packed if n >= PACKED else {}))
    for start in range(0, n, BLOCK):
        time[start : start + BLOCK] = record.t0 + record.dt * np.arange(start, min(start + BLOCK, n))
    time.attrs["units"] = "s"
    time.make_scale("time")


def _record(group: h5py.Group) -> tuple[Record, Floats | None]:
    parts = tuple(_part(row) for row in json.loads(group["parts"].asstr()[()]))
    record = Record(
        u=group["u"][()],
        y=group["y"][()],
        dt=float(group["dt"][()]),
        t0=float(group["t0"][()]),
        valid=group["valid"][()].astype(bool) if "valid" in group else None,
        units={"input": group["u"].attrs["units"], "output": group["y"].attrs["units"]},
        parts=parts,
        **{name: group.attrs[name] for name in WORDS},
    )
    return record, group["residual"][()] if "residual" in group else None


def _part(row: dict[str, Any]) -> Part:
    kind: Any = Part.named(row.pop("kind"))
    names = {yaml_key(name): name for name in kind.__dataclass_fields__}
    part: Part = kind(**{names[key]: tuple(value) if isinstance(value, list) else value for key, value in row.items()})
    return part


def _metrics(group: h5py.Group, result: Result, unit: Callable[[str], str], of: Units) -> None:
    group.attrs["NX_class"] = "NXcollection"
    for name, metric in result.metrics.items():
        value, std = metric if isinstance(metric, Measured) else (metric, None)
        array(group, name, float(value), units(unit(name), of))
        if std is not None:
            array(group, f"{name}_errors", float(std), units(unit(name), of))


def _number(item: h5py.Dataset) -> float | Measured:
    errors = item.parent.get(f"{item.name.rpartition('/')[2]}_errors")
    return float(item[()]) if errors is None else Measured(float(item[()]), float(errors[()]))


def _provenance(group: h5py.Group, result: Result) -> None:
    group.attrs["NX_class"] = "NXcollection"
    for name, value in {**result.provenance, "truth": result.truth}.items():
        put(group, name, value, "1", {})
        attach(group, name)
    kept = {name: getattr(result, name) for name in KEPT}
    tables = [table._replace(rows=tuple(tuple(map(_cell, row)) for row in table.rows)) for table in result.tables]
    array(group, "result", json.dumps(kept | {"tables": tables}, default=float), "")


def _cell(cell: Any) -> Any:
    return {"value": float(cell.value), "std": float(cell.std)} if isinstance(cell, Measured) else cell


def _table(row: list[Any]) -> Table:
    title, columns, rows, notes = row
    cells = (tuple(Measured(**c) if isinstance(c, dict) else c for c in cells) for cells in rows)
    return Table(title, tuple(columns), tuple(cells), tuple(notes))
