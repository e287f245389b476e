"""numpy archives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from whid.files.table import Table, of_arrays


def read(path: Path) -> Table:
    """Return the table of the numeric arrays of an archive; pickled objects are left alone."""
    arrays: dict[str, NDArray[np.generic]] = {}
    with np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            try:
                arrays[name] = archive[name]
            except ValueError:  # an object array: would have to be unpickled
                continue
    return of_arrays(path, arrays)
