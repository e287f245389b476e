"""HDF5 files as tables: every numeric dataset a column, named by its path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from whid.files.table import Table, of_arrays


class _Lazy:
    """A dataset that is read, by opening its file again, when somebody asks for its values."""

    def __init__(self, path: Path, dataset: Any) -> None:
        self.path, self.name, self.shape, self.dtype = path, dataset.name, dataset.shape, dataset.dtype

    def __getitem__(self, _: tuple[()]) -> NDArray[Any]:
        with h5py.File(self.path, "r") as file:
            return np.asarray(file[self.name][()])


def read(path: Path) -> Table:
    """Return the table of an HDF5 file; the attribute `units` of a dataset is its unit."""
    arrays: dict[str, _Lazy] = {}
    units: dict[str, str] = {}

    def visit(name: str, item: Any) -> None:
        text = item.attrs.get("MATLAB_class", b"") == b"char"
        if isinstance(item, h5py.Dataset) and item.shape is not None and not text:
            arrays[name] = _Lazy(path, item)
            if isinstance(unit := item.attrs.get("units"), (str, bytes)):
                units[name] = unit.decode(errors="replace") if isinstance(unit, bytes) else unit

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return of_arrays(path, arrays, units)
