"""A file of measurements as a table: columns by name or number, and single numbers beside them."""

from __future__ import annotations

import difflib
import importlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.signal import Floats

READERS = {
    ".csv": "csv", ".txt": "csv", ".tsv": "csv", ".dat": "csv", ".asc": "csv",
    ".npz": "npz", ".mat": "mat", ".h5": "hdf5_table", ".hdf5": "hdf5_table",
}  # fmt: skip
NAMES = {
    "time": ("t", "time", "zeit", "timestamp", "seconds", "sec"),
    "input": ("u", "input", "in", "uest", "command", "cmd", "excitation", "stimulus"),
    "output": ("y", "output", "out", "yest", "response", "measured", "measurement"),
}
MOST_SUBCOLUMNS = 64  # of a two-dimensional array


class Table(NamedTuple):
    """What a reader returns; columns are read when they are asked for.

    units   column name → unit, where the file says so
    scalars name → value of every single number in the file
    load    column numbers → columns; raises `WhidError` naming file and row
    where   sample → "file:row", of what has been read so far
    blocks  column numbers → the same columns bit by bit, in order; None: the format cannot
    """

    names: tuple[str, ...]
    units: dict[str, str]
    scalars: dict[str, float]
    load: Callable[[Sequence[int]], list[Floats]]
    where: Callable[[int], str]
    named: bool = True  # False: the file has no header, columns are called 0, 1, …
    note: str = ""
    blocks: Callable[[Sequence[int]], Iterator[list[Floats]]] | None = None

    def find(self, column: str | int) -> int:
        """Return a column's number; raise `WhidError("data-column")` with the nearest name when there is none."""
        if isinstance(column, int):
            if column < len(self.names):
                return column
            raise WhidError("data-column", f"no column {column}; the file has {len(self.names)}, counted from 0")
        wanted = bare(column)[0]
        for candidate in (column, wanted):
            if candidate in self.names:
                return self.names.index(candidate)
        folded = [name.casefold() for name in self.names]
        if folded.count(wanted.casefold()) == 1:
            return folded.index(wanted.casefold())
        near = difflib.get_close_matches(wanted, self.names, n=1)
        hint = f", did you mean {near[0]!r}? The" if near else "; the"
        raise WhidError("data-column", f"no column {column!r}{hint} file has {', '.join(self.names[:20]) or 'none'}")

    def guess(self, role: str) -> int | None:
        """Return the number of the only column whose name says time, input or output."""
        folded = [name.casefold().rpartition("/")[2].rpartition(".")[2] for name in self.names]
        if role == "time":
            folded = [re.sub(r"_(s|ms|us|ns|min|h)$", "", name) for name in folded]
        for name in NAMES[role]:
            if folded.count(name) == 1:
                return folded.index(name)
        return None


def open_table(path: Path, **text: Any) -> Table:
    """Return the table of a file, read according to its suffix; `text` options go to the reader of text files.

    Raises `WhidError("data-unreadable")` for a suffix that nobody reads and for anything a library stumbles over.
    """
    suffix = path.with_suffix("").suffix if path.suffix.lower() == ".gz" else path.suffix
    reader = READERS.get(suffix.lower(), "")
    if not reader or (path.suffix.lower() == ".gz" and reader != "csv"):
        raise WhidError("data-unreadable", f"no reader for {path.suffix or 'a file without suffix'}", str(path))
    if path.stat().st_size == 0:
        raise WhidError("data-unreadable", "the file is empty", str(path))
    read = importlib.import_module(f"whid.files.{reader}").read
    table: Table = guarded(path, lambda: read(path, **text) if reader == "csv" else read(path))
    blocks = table.blocks
    return table._replace(
        load=lambda columns: guarded(path, lambda: table.load(columns)),
        blocks=blocks and (lambda columns: _guarded_blocks(path, blocks(columns))),
    )


def _guarded_blocks(path: Path, blocks: Iterator[list[Floats]]) -> Iterator[list[Floats]]:
    while (block := guarded(path, lambda: next(blocks, None))) is not None:
        yield block


def guarded(path: Path, read: Callable[[], Any]) -> Any:
    """Return read(), any stumble of a library over a foreign file turned into a named fault."""
    try:
        return read()
    except WhidError as fault:
        raise fault if fault.where else WhidError(fault.code, fault.message, path.name) from fault
    except Exception as fault:  # a damaged file makes zip, zlib, HDF5 and scipy raise whatever they like
        raise WhidError(
            "data-unreadable", f"damaged, or not what its name says: {fault or type(fault).__name__}"[:300], str(path)
        ) from fault


def of_arrays(path: Path, arrays: Mapping[str, Any], units: Mapping[str, str] | None = None) -> Table:
    """Return the table of named arrays: vectors and the columns of matrices are columns, single numbers are scalars."""
    columns: dict[str, Callable[..., Floats]] = {}
    scalars: dict[str, float] = {}
    for name, array in arrays.items():
        if array.dtype.kind not in "fiub":
            continue
        shape = tuple(n for n in array.shape if n != 1)
        if not shape:
            scalars[name] = float(np.asarray(array[()]).reshape(()))
        elif len(shape) == 1:
            columns[name] = partial(_vector, array)
        elif len(shape) == 2 and min(shape) <= MOST_SUBCOLUMNS:
            for k in range(min(shape)):
                columns[f"{name}.{k}"] = partial(_vector, array, k)
    reads = list(columns.values())
    return Table(
        tuple(columns),
        dict(units or {}),
        scalars,
        lambda wanted: [reads[k]() for k in wanted],
        lambda sample: f"{path.name}: sample {sample}",
    )


def _vector(array: Any, column: int = 0) -> Floats:
    values = np.squeeze(np.asarray(array[()], float))
    if values.ndim == 1:
        return values
    return values[:, column] if values.shape[0] >= values.shape[1] else values[column]


def bare(header: str) -> tuple[str, str]:
    """Split a heading into name and unit.

    >>> bare("Time [ms]"), bare("u (V)"), bare("Time, s"), bare("y")
    (('Time', 'ms'), ('u', 'V'), ('Time', 's'), ('y', ''))
    """
    found = re.fullmatch(r"\s*(.+?)\s*[\[(]([^\[\]()]*)[\])]\s*", header)
    found = found or re.fullmatch(r"\s*(.+?), (s|ms|us|µs|μs|ns|min|h)\s*", header)
    return (found[1], found[2].strip()) if found else (header.strip(), "")
