"""HDF5 files as tables: every numeric dataset a column, named by its path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.files.table import Table, of_arrays
from whid.signal import Floats

BLOCK = 1 << 17  # samples read at a time


class _Lazy:
    """A dataset that is read, by opening its file again, when somebody asks for its values."""

    def __init__(self, path: Path, dataset: Any) -> None:
        self.path, self.name, self.shape, self.dtype = path, dataset.name, dataset.shape, dataset.dtype

    def __getitem__(self, _: tuple[()]) -> NDArray[Any]:
        with h5py.File(self.path, "r") as file:
            return np.asarray(file[self.name][()])


def longest(path: Path) -> int:
    """Return the length of the longest axis of any dataset: the samples of a column, however well they are packed."""
    found = [0]
    with h5py.File(path, "r") as file:
        file.visititems(lambda _, item: found.extend(getattr(item, "shape", None) or ()))
    return max(found)


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
    table = of_arrays(path, arrays, units)

    def blocks(columns: Sequence[int]) -> Iterator[list[Floats]]:
        with h5py.File(path, "r") as file:
            chosen = [_Column(file, name) for name in (table.names[k] for k in columns)]
            if len({column.samples for column in chosen}) > 1:
                lengths = ", ".join(f"{column.name} {column.samples}" for column in chosen)
                raise WhidError("data-length", f"the columns differ in length: {lengths}")
            for start in range(0, chosen[0].samples, BLOCK):
                yield [column.stretch(start, start + BLOCK) for column in chosen]

    return table._replace(blocks=blocks)


class _Column:
    """A vector, or a row or column `name.k` of a matrix, read piece by piece."""

    def __init__(self, file: Any, name: str) -> None:
        self.name, matrix, number = name, *name.rpartition(".")[::2]
        self.dataset = file[name] if name in file else file[matrix]
        self.number = None if name in file else int(number)
        self.long = int(np.argmax(self.dataset.shape))  # the axis of time
        self.samples = int(self.dataset.shape[self.long])

    def stretch(self, start: int, stop: int) -> Floats:
        """Return samples start … stop − 1, as far as there are."""
        at: list[Any] = [0] * len(self.dataset.shape)
        if self.number is not None:
            at[next(k for k, n in enumerate(self.dataset.shape) if n > 1 and k != self.long)] = self.number
        at[self.long] = slice(start, stop)
        return np.asarray(self.dataset[tuple(at)], float)
