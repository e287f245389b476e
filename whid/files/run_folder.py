"""The folder of a run: built under a hidden name, synced, then renamed; nothing is ever overwritten."""

from __future__ import annotations

import os
import secrets
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from whid.errors import WhidError

DONE = "DONE"


class RunFolder:
    """A run's folder in the making; `keep` gives it the first free name of `<stem>`, `<stem>.2`, … in turn.

    A process that dies on the way leaves a hidden folder without DONE, which no later run looks at; two processes
    never share one. Raises `WhidError("run-folder")` where it cannot be made.
    """

    def __init__(self, out: Path, stem: str) -> None:
        self.out, self.stem, self.started = out, stem, time.perf_counter()
        self.path = out / f".{stem}.{os.getpid()}.{secrets.token_hex(4)}"
        try:
            self.path.mkdir(parents=True)
        except OSError as fault:
            raise WhidError("run-folder", f"cannot make a run folder: {fault.strerror}", str(out)) from fault

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        shutil.rmtree(self.path, ignore_errors=True)  # gone already when it was kept
        if isinstance(value, OSError):
            raise WhidError("run-folder", f"cannot write the result: {value.strerror or value}", str(self.out)) from value

    def log(self, line: str) -> None:
        """Add a line to log.txt, with the seconds since the start."""
        with (self.path / "log.txt").open("a", encoding="utf-8") as log:
            log.write(f"{time.perf_counter() - self.started:9.3f} s  {line}\n")

    def write(self, name: str, text: str) -> None:
        """Write a text file."""
        (self.path / name).write_text(text, encoding="utf-8")

    def keep(self, done: str = "") -> Path:
        """Write DONE with this text (none for a run that failed), sync everything, rename, return the final path."""
        if done:
            self.write(DONE, done + "\n")
        for item in [*self.path.iterdir(), self.path]:
            _sync(item)
        while True:
            path = next(path for path in _siblings(self.out / self.stem) if not path.exists())
            try:
                self.path.rename(path)
                break
            except OSError:
                if not path.exists():  # otherwise another process was quicker
                    raise
        _sync(self.out)
        return path


def finished(out: Path, stem: str) -> Path | None:
    """Return the newest finished folder of a stem."""
    found = None
    for path in _siblings(out / stem):
        if not path.exists():
            return found
        found = path if (path / DONE).exists() else found
    return found


def last(out: Path) -> Path | None:
    """Return the folder that was finished last, for `whid show` without a name."""
    done = [path.parent for path in out.glob(f"*/{DONE}")]
    return max(done, key=lambda path: (path / DONE).stat().st_mtime, default=None)


def stem(name: str, identity: str) -> str:
    """Return `<name>-<hash10>`.

    >>> stem("starter", "0123456789abcdef")
    'starter-0123456789'
    """
    return f"{name}-{identity[:10]}"


def _siblings(base: Path) -> Iterator[Path]:
    yield base
    number = 2
    while True:
        yield base.with_name(f"{base.name}.{number}")
        number += 1


def _sync(path: Path) -> None:
    """Force a file or a folder onto the disk; where the system cannot sync a folder, the rename still stands."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        if not path.is_dir():
            raise
    finally:
        os.close(handle)
