"""Every fault whid can name: a code, what was wrong, where, and what to try (`whid explain CODE`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Explanation(NamedTuple):
    """What a code means, what to try, and the exit code of a command that stops on it."""

    meaning: str
    remedy: str
    exit_code: int


CONFIG, FAILED = 2, 3

# One line a code; `whid explain` prints this table, a test holds every raised code against it.
CATALOGUE: dict[str, Explanation] = {
    "file-access": Explanation(
        "The operating system refused a file: it is missing, may not be read or written, or the disk is full.",
        "Check the path, its permissions and the free space.",
        FAILED,
    ),
    "config-kind": Explanation(
        "A `kind:` names nothing that whid knows.", "List what there is with `whid kinds`.", CONFIG
    ),
    "block-parameters": Explanation(
        "A block's numbers contradict each other or do not describe a block.",
        "Read the block's line in `whid kinds` and its equation in its docstring.",
        CONFIG,
    ),
    "block-no-steady-state": Explanation(
        "A block has no steady state at this input (an integrator, or a feedback that does not settle).",
        "Use `initial: rest` or `initial: free`.",
        FAILED,
    ),
    "fit-rank": Explanation(
        "The data do not determine every parameter of a fit.",
        "Read the identifiability report: it names the free directions and an experiment that would pin them.",
        FAILED,
    ),
}


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
