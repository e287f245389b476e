"""MATLAB files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from whid.files.table import Table, of_arrays


def read(path: Path) -> Table:
    """Return the table of a MATLAB file, fields of structs as `struct.field`; version 7.3 is HDF5."""
    with path.open("rb") as file:
        if b"MATLAB 7.3" in file.read(128):
            from whid.files import hdf5_table

            return hdf5_table.read(path)
    from scipy.io import loadmat

    return of_arrays(path, dict(_flat(loadmat(path, simplify_cells=True))))


def _flat(fields: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in fields.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        elif not name.startswith("__") and np.ndim(value) <= 2:
            yield prefix + name, np.asarray(value)
