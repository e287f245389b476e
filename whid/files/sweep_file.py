"""The HDF5 file of a sweep: one array a metric, cells × repeats."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from whid.files._new_hdf5 import new_hdf5
from whid.signal import Floats

LARGE = 1 << 12  # bytes
KEPT = ("over", "values", "std", "errors", "truth", "bound", "records")  # of a `SweepResult`


def write_sweep(path: Path, found: Mapping[str, Any], origin: Mapping[str, Any], metric_units: Callable[[str], str]) -> None:
    """Write what a `SweepResult` holds under the names `KEPT`; metrics have their `<name>_errors` beside them."""
    size = sum(3 * array.nbytes for array in found["values"].values())
    with new_hdf5(path, size) as file:
        file.attrs["NX_class"] = "NXroot"
        file.create_dataset("over", data=json.dumps(found["over"]))  # the swept values exactly as they were declared
        cells = file.create_group("cells")
        for name, column in found["over"].items():
            numeric = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in column)
            data = np.array(column, float) if numeric else [str(v) for v in column]
            cells.create_dataset(name, data=data).make_scale(name)
        repeat = file.create_dataset("repeat", data=np.arange(found["errors"].shape[1]))
        repeat.make_scale("repeat")
        group = file.create_group("metrics", track_order=True)
        for name, array in found["values"].items():
            both = {name: array, f"{name}_errors": found["std"][name]}
            for each, data in both.items():
                dataset = group.create_dataset(each, data=data, compression="gzip" if _mostly_missing(data) else None)
                dataset.attrs["units"] = metric_units(name)
                for scale in cells.values():
                    dataset.dims[0].attach_scale(scale)
                dataset.dims[1].attach_scale(repeat)
        for kind in ("truth", "bound"):
            columns = file.create_group(kind)
            for name, column in found[kind].items():
                columns.create_dataset(name, data=column).attrs["units"] = metric_units(name)
        file.create_dataset("records", data=list(found["records"]), dtype=h5py.string_dtype())
        failures = found["errors"].astype(h5py.string_dtype())
        file.create_dataset("failures", data=failures, dtype=h5py.string_dtype(), compression="gzip")
        for name, value in origin.items():
            file.attrs[name] = value if isinstance(value, (str, int, float)) else str(value)


def _mostly_missing(data: Floats) -> bool:
    """Tell whether packing pays: in thousands of cells there is always one that reads the data in its own way."""
    return bool(data.nbytes > LARGE and np.isnan(data).mean() > 0.5)


def read_sweep(path: Path) -> dict[str, Any]:
    """Return what `write_sweep` wrote, by the same names."""
    with h5py.File(path) as file:
        over = {name: tuple(values) for name, values in json.loads(file["over"].asstr()[()]).items()}
        found = {name: np.asarray(dataset) for name, dataset in file["metrics"].items()}
        errors = np.asarray(file["failures"].asstr()[()], object)
        records = tuple(file["records"].asstr()[()]) if "records" in file else ()  # files of before had none
        judged = {kind: {name: np.asarray(d) for name, d in file[kind].items()} for kind in ("truth", "bound")}
    values = {name: array for name, array in found.items() if not name.endswith("_errors")}
    std = {name: found[f"{name}_errors"] for name in values}
    return {"over": over, "values": values, "std": std, "errors": errors, "records": records, **judged}
