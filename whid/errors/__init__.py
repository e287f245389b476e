"""Every fault whid can name: a code, what was wrong, where, and what to try (`whid explain CODE`).

The codes are explained in this folder's files, one an area; a test holds every raised code against them.
"""

from __future__ import annotations

from collections.abc import Sequence

from whid.errors import _config, _data, _method, _run
from whid.errors._explanation import CONFIG, FAILED, NOT_MEASURED, Explanation

__all__ = ["CATALOGUE", "CONFIG", "FAILED", "NOT_MEASURED", "Explanation", "Faults", "WhidError"]

CATALOGUE = _config.CATALOGUE | _data.CATALOGUE | _method.CATALOGUE | _run.CATALOGUE


class WhidError(Exception):
    """One named fault; `str()` is one line, `where: message`."""

    def __init__(self, code: str, message: str, where: str = "") -> None:
        super().__init__(f"{where}: {message}" if where else message)
        self.code, self.message, self.where = code, message, where

    @property
    def exit_code(self) -> int:
        """Return the exit code of a command that stops on this fault."""
        return CATALOGUE[self.code].exit_code

    @property
    def remedy(self) -> str:
        """Return what to try."""
        return CATALOGUE[self.code].remedy


class Faults(WhidError):
    """Several faults reported at once, each with its place."""

    def __init__(self, faults: Sequence[WhidError]) -> None:
        super().__init__(faults[0].code, "\n".join(str(fault) for fault in faults))
        self.faults = tuple(faults)
