"""A new HDF5 file that a full disk cannot turn into a crash."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

MEMORY = 1 << 25  # bytes: a file of at most that size is built in memory


@contextmanager
def new_hdf5(path: Path, size: int = 0) -> Iterator[h5py.File]:
    """Yield an empty file that stands on the disk, whole, when the block ends; size: what it may take at most, bytes.

    HDF5 takes the process down when it cannot write what it has begun (a segmentation fault as its objects are closed). So
    a file of ordinary size is built in memory and written in one piece, and the space for a larger one is looked for
    first. Raises `OSError`.
    """
    if size <= MEMORY:
        with h5py.File(path, "w", driver="core", backing_store=False) as file:
            yield file
            file.flush()
            image = file.id.get_file_image()
        path.write_bytes(image)
        return
    if (free := shutil.disk_usage(path.parent).free) < size:
        raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)}: {free / 1e9:.3g} GB are free, {size / 1e9:.3g} needed")
    with h5py.File(path, "w") as file:
        yield file
