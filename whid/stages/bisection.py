"""Where a static curve needs more levels: inside the gap of a border."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages.segmentation import Segmentation

DECIDED = 10.8  # χ² by which a level must belong to one piece rather than to its neighbour
HIDDEN = 10.0
FINE = 1.5e-3  # of the range: a gap that is narrower is left


class Bisection(NamedTuple):
    """Borders closed in on by levels in the middle of their gaps."""

    before: Annotated[Floats, Quantity("input", ("border", "side"))]  # (S, 2)
    after: Annotated[Floats, Quantity("input", ("border", "side"))]
    levels: Annotated[NDArray[np.intp], Quantity("1", ("border",))]  # how many it took
    decided: Annotated[NDArray[np.bool_], Quantity("1", ("border",))]  # False: the last level could be of either piece

    def table(self) -> Table:
        """Return one row a border."""
        rows = tuple(
            (f"{a:.6g} … {b:.6g}", f"{c:.6g} … {d:.6g}", int(n), "" if sure else "the last level could be of either piece")
            for (a, b), (c, d), n, sure in zip(self.before, self.after, self.levels, self.decided, strict=True)
        )
        return Table("Borders bisected", ("between, input", "after it between, input", "levels", ""), rows)


def wide(pieces: Segmentation, span: float, std: float) -> list[int]:
    """Return the borders worth a level: gap wider than 1.5e-3 of the range, and a jump, or a kink that could hide one.

    A kink could where the largest jump that fits its gap as well is more than ten standard errors of a level.
    """
    width = np.diff(pieces.borders, axis=1)[:, 0] if len(pieces.borders) else np.empty(0)
    unclear = pieces.jump | (pieces.hidden_jump > HIDDEN * std)
    return [int(k) for k in np.flatnonzero(unclear & (width > FINE * span))]


def side(pieces: Segmentation, k: int, level: float, mean: float, std: float) -> int:
    """Return which piece at border k a level belongs to: −1 the left, +1 the right, 0 not decided.

    By (mean − f(level))²/(std² + var f(level)) of the two pieces carried on into the gap, apart by 10.8 or more, and the
    better one itself below that.
    """
    misfits: list[float] = []
    for piece in (k, k + 1):
        row, value = row_of(pieces, piece, level)
        variance = std**2 + float(row @ pieces.estimate.covariance @ row)
        misfits.append((mean - value) ** 2 / max(variance, (1e-12 * (abs(mean) + 1e-300)) ** 2))
    left, right = misfits
    if abs(left - right) < DECIDED or min(misfits) > DECIDED:
        return 0
    return -1 if left < right else 1


def row_of(pieces: Segmentation, piece: int, level: float) -> tuple[Floats, float]:
    """Return the derivatives of a piece's value at a level with respect to all parameters, and the value."""
    names = pieces.estimate.names
    row = np.zeros(len(names))
    for power in range(int(pieces.degrees[piece]) + 1):
        row[names.index(f"pieces.{piece}.{power}")] = level**power
    return row, float(row @ pieces.estimate.values)
