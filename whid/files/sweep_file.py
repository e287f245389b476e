"""The HDF5 file of a sweep: one array a metric, cells × repeats."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def write_sweep(
    path: Path,
    over: Mapping[str, tuple[Any, ...]],
    values: Mapping[str, Floats],
    std: Mapping[str, Floats],
    errors: NDArray[Any],
    origin: Mapping[str, Any],
    metric_units: Callable[[str], str],
) -> None:
    """Write cells (the swept values), metrics with `<name>_errors`, failures and provenance."""
    with h5py.File(path, "w") as file:
        file.attrs["NX_class"] = "NXroot"
        file.attrs["over"] = json.dumps(over)  # the swept values exactly as they were declared
        cells = file.create_group("cells")
        for name, column in over.items():
            numeric = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in column)
            data = np.array(column, float) if numeric else [str(v) for v in column]
            cells.create_dataset(name, data=data).make_scale(name)
        repeat = file.create_dataset("repeat", data=np.arange(errors.shape[1]))
        repeat.make_scale("repeat")
        group = file.create_group("metrics")
        for name, array in values.items():
            for dataset in (
                group.create_dataset(name, data=array),
                group.create_dataset(f"{name}_errors", data=std[name]),
            ):
                dataset.attrs["units"] = metric_units(name)
                for scale in cells.values():
                    dataset.dims[0].attach_scale(scale)
                dataset.dims[1].attach_scale(repeat)
        file.create_dataset("failures", data=errors.astype(h5py.string_dtype()), dtype=h5py.string_dtype())
        for name, value in origin.items():
            file.attrs[name] = value if isinstance(value, (str, int, float)) else str(value)


def read_sweep(path: Path) -> tuple[dict[str, tuple[Any, ...]], dict[str, Floats], dict[str, Floats], NDArray[Any]]:
    """Return what `write_sweep` wrote: swept values, metrics, their standard errors, failures."""
    with h5py.File(path) as file:
        over = {name: tuple(values) for name, values in json.loads(str(file.attrs["over"])).items()}
        found = {name: np.asarray(dataset) for name, dataset in file["metrics"].items()}
        errors = np.asarray(file["failures"].asstr()[()], object)
    values = {name: array for name, array in found.items() if not name.endswith("_errors")}
    return over, values, {name: found[f"{name}_errors"] for name in values}, errors
