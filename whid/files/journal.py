"""The journal of a sweep under way: what is finished is kept at once, whatever becomes of the process.

SQLite, one transaction a batch: a kill at any moment leaves the batches before it, whole. HDF5 has no such append, so the
sweep's HDF5 file is written once, from the journal, when everything is there.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Self

from whid.errors import WhidError

UNFINISHED = ".unfinished"  # the journal of runs/<stem> is runs/<stem>.unfinished
BESIDE = "", "-wal", "-shm"  # what SQLite keeps beside it after a kill
# Write-ahead: a batch waits for no disk, so that thousands of cells of one repeat cost what they compute. A killed process
# loses nothing by that; a machine that loses its power may lose the last batches, but not the file.
SETTINGS = "locking_mode = EXCLUSIVE", "journal_mode = WAL", "synchronous = NORMAL"
TABLES = """
CREATE TABLE IF NOT EXISTS sweep (hash TEXT NOT NULL, config TEXT NOT NULL, tasks INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS outcome (
    cell INTEGER, repeat INTEGER, metrics TEXT NOT NULL, error TEXT NOT NULL, records TEXT NOT NULL DEFAULT '',
    PRIMARY KEY (cell, repeat));
"""


class Outcome(NamedTuple):
    """One repeat of one cell: its metrics with their standard errors, or why there are none.

    records: "" where statistics were drawn, else why there was a whole record
    """

    metrics: Mapping[str, tuple[float, float]]
    error: str = ""
    records: str = ""


Place = tuple[int, int]  # cell, repeat


class Journal:
    """The outcomes of one sweep so far, in a file of its own; one process at a time.

    Raises `WhidError("sweep-running")` where another process writes it, `WhidError("sweep-mixed")` where it belongs to
    another config or other data, `WhidError("run-folder")` where it cannot be written.
    """

    def __init__(self, path: Path, identity: str, config: str, tasks: int) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.file = sqlite3.connect(path, timeout=0.2, isolation_level=None, check_same_thread=False)
            for setting in SETTINGS:
                self.file.execute(f"PRAGMA {setting}")
            self.file.execute("BEGIN EXCLUSIVE")
            for statement in TABLES.split(";"):
                self.file.execute(statement)
            known = self.file.execute("SELECT hash FROM sweep").fetchone()
            if known is None:
                self.file.execute("INSERT INTO sweep VALUES (?, ?, ?)", (identity, config, tasks))
            self.file.execute("COMMIT")
        except (sqlite3.Error, OSError) as fault:
            if "locked" in str(fault):
                raise WhidError("sweep-running", "another process is at this sweep", str(path)) from None
            raise WhidError("run-folder", f"cannot keep the journal of a sweep: {fault}", str(path)) from fault
        if known is not None and known[0] != identity:
            self.file.close()
            raise WhidError("sweep-mixed", "the journal of another config, other data or another version", str(path))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def add(self, outcomes: Sequence[tuple[Place, Outcome]]) -> None:
        """Keep a batch: all of it or, if the process ends on the way, nothing."""
        rows = [(*place, json.dumps(o.metrics), o.error, o.records) for place, o in outcomes]
        self.file.execute("BEGIN")
        self.file.executemany("INSERT OR REPLACE INTO outcome VALUES (?, ?, ?, ?, ?)", rows)
        self.file.execute("COMMIT")

    def places(self) -> set[Place]:
        """Return what is finished."""
        return set(self.file.execute("SELECT cell, repeat FROM outcome"))

    def outcomes(self) -> Iterator[tuple[Place, Outcome]]:
        """Yield everything that is finished, in order."""
        rows = self.file.execute("SELECT cell, repeat, metrics, error, records FROM outcome ORDER BY cell, repeat")
        for cell, repeat, metrics, error, records in rows:
            yield (cell, repeat), Outcome({name: (v, s) for name, (v, s) in json.loads(metrics).items()}, error, records)

    def discard(self) -> None:
        """Remove the file: its outcomes stand elsewhere now."""
        self.file.close()
        for name in BESIDE:
            self.path.with_name(self.path.name + name).unlink(missing_ok=True)


def progress(path: Path) -> tuple[int, int] | None:
    """Return how many outcomes an unfinished sweep has, and of how many; None while a process is at it.

    Raises `WhidError("result-unreadable")` for a file that is no journal.
    """
    try:
        file = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=0.1)
        try:
            done = file.execute("SELECT count(*) FROM outcome").fetchone()[0]
            return int(done), int(file.execute("SELECT tasks FROM sweep").fetchone()[0])
        finally:
            file.close()
    except sqlite3.OperationalError as fault:
        if "locked" in str(fault):
            return None
        raise WhidError("result-unreadable", f"not the journal of a sweep: {fault}", str(path)) from None
    except (sqlite3.DatabaseError, TypeError) as fault:
        raise WhidError("result-unreadable", f"not the journal of a sweep: {fault}", str(path)) from None
