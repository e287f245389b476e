"""How much memory a study will need, before anything starts."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from whid.config.study import Study
from whid.errors import WhidError
from whid.files import hdf5_table, ingest_long
from whid.files.source import DataSource, locate

START = 200_000_000  # bytes: Python with numpy, scipy, matplotlib and h5py loaded, and the pictures
SAMPLE = 90  # bytes a sample at the peak; measured with the starter at 1e6 … 1e7 samples: 54 … 75
WORK = 100_000_000  # beside it in chunks: blocks of periods, samples for the noise; measured from 1e7 samples on: 10 … 80 MB
FILE = {".csv": 6, ".txt": 6, ".tsv": 6, ".dat": 6, ".gz": 30}  # a byte of text in bytes at the peak; gzip is 5 to 1
BINARY = 8  # 24 bytes a sample in the file
CHUNKED = frozenset({".csv", ".txt", ".tsv", ".dat", ".asc", ".gz", ".h5", ".hdf5"})
UNITS = {"": 1, "B": 1, "KB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}


def memory(study: Study, base: Path = Path()) -> int:
    """Return an estimate of the peak memory of `whid run`, bytes; base is the folder that data files are relative to.

    START + SAMPLE · samples simulated or in HDF5 + (6 … 30) · size of other data files. An experiment too long to count is
    sys.maxsize.
    """
    try:
        simulated = sum(experiment.samples() for experiment in study.experiment)
        simulated += max((each.adaptive.max_samples for each in study.experiment if each.adaptive), default=0)
    except (OverflowError, MemoryError):
        return sys.maxsize
    return min(START + SAMPLE * simulated + sum(_file(source, base) for source in study.sources), sys.maxsize)


def allow(study: Study, limit: float, base: Path = Path()) -> bool:
    """Tell whether a study goes through its records in chunks, because whole they would need more than `limit` bytes.

    Below the limit records are held whole: everything can be done with them. Raises `WhidError("memory")` where chunks do
    not help: a method that needs whole records, or a closed loop; an input that is drawn at once.
    """
    needed = memory(study, base)
    if needed <= limit and needed < sys.maxsize:
        return False
    why = whole(study)
    if not why:
        least = in_chunks(study)
        if least <= limit:
            return True
        why = f"in chunks {human(least)}, for an input that is drawn at once"
    raise WhidError("memory", f"this study needs about {human(needed)}, {human(limit)} are allowed; {why}")


def whole(study: Study) -> str:
    """Return why a study's records must be in memory whole, "" where they may come in chunks."""
    if study.trace is not None:
        return "the closed loop needs whole records in memory"
    for source in study.sources:
        if not (suffix := Path(source.file).suffix.lower()) or suffix not in CHUNKED:
            return f"{source.file}: only {', '.join(sorted(CHUNKED))} are read in chunks"
        if why := ingest_long.whole(source):
            return f"{source.name}: {why}"
    return study.identify.whole_records()


def in_chunks(study: Study) -> int:
    """Return the peak memory of a run that goes through its records in chunks, bytes: whatever their length."""
    kept = [part.numbers(experiment.dt) for experiment in study.experiment for part in experiment.plan()]
    return START + WORK + 8 * max(kept, default=0)


def size(text: str) -> int:
    """Return a size such as 4GB, 500 MB or 1e9 in bytes; raise `WhidError("config-value")`.

    >>> size("4GB"), size("1.5 mb")
    (4000000000, 1500000)
    """
    found = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]{1,2})?)\s*([KMGT]?B?)\s*", text, re.IGNORECASE)
    unit = found[2].upper() if found else ""
    try:
        return int(float(found[1]) * UNITS[unit if unit.endswith("B") or not unit else unit + "B"])  # type: ignore[index]
    except (TypeError, ValueError):
        raise WhidError("config-value", "must be a size such as 4GB or 500MB", text) from None


def human(count: float) -> str:
    """Return a number of bytes as people read it.

    >>> human(2.52e9), human(153_400_000)
    ('2.52 GB', '153 MB')
    """
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"


def _file(source: DataSource, base: Path) -> int:
    try:
        path = locate(source.file, base)
    except (WhidError, OSError, ValueError):
        return 0  # that the file is missing is said by whoever opens it
    size = path.stat().st_size * FILE.get(path.suffix.lower(), BINARY)
    if path.suffix.lower() in (".h5", ".hdf5"):
        try:
            return max(size, SAMPLE * hdf5_table.longest(path))  # a packed file says little
        except (OSError, RuntimeError):
            pass  # that it cannot be read is said by whoever opens it
    return size
