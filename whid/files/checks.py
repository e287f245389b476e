"""What makes a record useless, found before anybody fits it: dead columns, swapped columns, too few samples. Pure."""

from __future__ import annotations

import numpy as np

from whid.errors import WhidError
from whid.files.grid import Where
from whid.signal import Floats
from whid.stages.causality import causality

FEWEST = 16  # samples
MOST = 1e30  # of any quantity an instrument reads; 9.9e37 is how many write an overload
FAR, ALONE = 100.0, 0.01  # spans of the rest, share of the samples: what lies so far out is worth a note
HUGE = 1e60  # beyond it, and below one over it, squares of squares leave the range of a float
STUCK = 0.2  # of the record: a last stretch without any change is worth a note
HELD = 0.75  # of the samples equal to their predecessor: the column looks like a held command


def check_alive(x: Floats, column: str, where: Where) -> None:
    """Raise `WhidError("data-dead")` for a column that never changes, `WhidError("data-range")` for one of no size."""
    low, high = float(x.min()), float(x.max())
    if max(-low, high) > MOST:
        first = int(np.flatnonzero(np.abs(x) > MOST)[0])
        raise WhidError("data-range", f"the {column} is {x[first]:.3g} here: an overload mark?", where(first))
    if high - low <= max(1e-13 * max(abs(low), abs(high)), 1 / HUGE):
        raise WhidError("data-dead", f"the {column} is {low:.6g} from the first row to the last", where(0))


def check_length(samples: int, where: str) -> None:
    """Raise `WhidError("data-length")` for a record that is too short."""
    if samples < FEWEST:
        raise WhidError("data-length", f"{samples} samples, at least {FEWEST} are needed", where)


def check_order_of_columns(u: Floats, y: Floats, where: Where) -> None:
    """Raise `WhidError("data-swapped")` when the declared output moves before the declared input.

    By prewhitened cross-correlation; where that cannot tell, by looks: a held, stepped column is a command.
    """
    verdict = causality(u, y).verdict
    if verdict == "swapped":
        step = int(np.argmax(np.abs(np.diff(y)))) + 1
        raise WhidError("data-swapped", "the output moves before the input does, as at this step", where(step))
    if verdict == "cannot tell" and held(y) > HELD and held(u) < 1 - HELD:
        step = int(np.flatnonzero(np.diff(y))[0]) + 1
        raise WhidError("data-swapped", "the output is held and stepped like a command, the input is not", where(step))


def like_a_command(u: Floats, y: Floats) -> tuple[str, ...]:
    """Return a note when y has long stretches of exactly one value, several of them, and u never repeats itself."""
    edges = np.flatnonzero(np.diff(y, prepend=np.nan, append=np.nan))
    long = np.diff(edges) >= FEWEST
    levels, share = len(np.unique(y[edges[:-1]][long])), float(np.diff(edges)[long].sum() / len(y))
    if levels < 4 or share < 1 / 4 or np.mean(np.diff(u) == 0) > 1 / 100:
        return ()
    return (f"the output stands still at {levels} levels, as a command does, and the input never does: swapped?",)


def held(x: Floats) -> float:
    """Return the fraction of samples that equal their predecessor; 0 for three values or fewer, as a relay gives."""
    return float(np.mean(np.diff(x) == 0)) if len(np.unique(x[: 10**6])) > 3 else 0.0


def far_out(x: Floats, column: str, where: Where) -> tuple[str, ...]:
    """Return a note when a few samples lie a hundred times further out than all others: -999 and its like."""
    low, high = np.quantile(x, (ALONE, 1 - ALONE))
    out = np.flatnonzero((x < low - FAR * (high - low)) | (x > high + FAR * (high - low)))
    if high <= low or not len(out):
        return ()
    more = f" and at {len(out) - 1} more samples" if len(out) > 1 else ""
    return (
        f"the {column} is {x[out[0]]:.6g} at {where(int(out[0]))}{more}, the rest within {low:.4g} … {high:.4g}:"
        " if that marks a missing sample, empty the cell",
    )


def stuck(u: Floats, y: Floats, where: Where) -> tuple[str, ...]:
    """Return a note when y stops changing for good while u goes on."""
    changes = np.flatnonzero(np.diff(y))
    last = int(changes[-1]) + 1 if len(changes) else 0
    if len(y) - last > STUCK * len(y) and np.ptp(u[last:]) > 0:
        return (f"the output does not change after {where(last)}, while the input does: a stuck sensor?",)
    return ()
