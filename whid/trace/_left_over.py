"""The residual before and after, sample by sample, for the pictures and for whoever wants to look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.effects._look import Look
from whid.effects._sites import Sites
from whid.quantity import Quantity
from whid.record import Record
from whid.signal import Floats
from whid.trace._floor import repeats


class LeftOver(NamedTuple):
    """What the declared model and the refined one leave over on one record, against time and against what drives the curve.

    driving  what enters the first declared curve (the output, where none is declared), by the declared model
    rising   whether it rises there
    period, lines  of the longest periodic part: its period, start and periods (0: none)
    """

    record: str
    time: Annotated[Floats, Quantity("s", ("time",))]
    before: Annotated[Floats, Quantity("output", ("time",))]
    after: Annotated[Floats, Quantity("output", ("time",))]
    driving: Annotated[Floats, Quantity("1", ("time",))]
    rising: Annotated[NDArray[np.bool_], Quantity("1", ("time",))]
    start: int
    period: int
    periods: int
    floor: Annotated[float, Quantity("output")]


def left_over(records: Sequence[Record], before: Look, after: Look, floor: float) -> LeftOver:
    """Return both residuals of the first record, report samples left out (NaN)."""
    record = records[0]
    sites = Sites(before.system, before.core)
    place = sites.nonlinear[0] if sites.nonlinear else sites.end
    v = before.signal(place)[0]
    y = np.where(record.mask, record.y, np.nan)
    periodic = [r for r in repeats(records, [r.y for r in records]) if r.record == 0]
    longest = max(periodic, key=lambda r: r.values.size, default=None)
    return LeftOver(
        record.name, record.time, y - before.predicted[0], y - after.predicted[0], v, np.gradient(v) > 0,
        longest.start if longest else 0, longest.period if longest else 0, len(longest.values) if longest else 0, floor,
    )  # fmt: skip
