"""Which samples rank: the selection parts, or a block of every estimation part where none is declared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whid.experiments._part import Part
from whid.record import Record

Bools = NDArray[np.bool_]
SHARE = 6  # of a part: one block in so many is kept back
SHORT = 60  # samples of a part: a shorter one is not cut


def cut(records: Sequence[Record]) -> tuple[tuple[Record, ...], tuple[Bools, ...]]:
    """Return the records as the fit may see them, and where the samples that rank are.

    Of a periodic part a whole period, of any other one block, inside the part: what comes before and after it was fitted.
    Of parts too short for that, such as the levels of a quick staircase, one in six is kept back whole.
    """
    if any(record.using("selection").any() for record in records):
        return tuple(records), tuple(r.using("selection") & np.isfinite(r.y) for r in records)
    masks = tuple(_kept(record) & record.using("estimation") & np.isfinite(record.y) for record in records)
    return tuple(replace(r, valid=r.mask & ~mask) for r, mask in zip(records, masks, strict=True)), masks


def _kept(record: Record) -> Bools:
    kept = np.zeros(len(record), bool)
    spans: list[tuple[int, int, Part | None]] = [
        (p.start or 0, p.stop or 0, p) for p in record.parts if p.use == "estimation"
    ]
    short = 0
    for start, stop, part in spans or [(0, len(record), None)]:
        if stop - start >= SHORT:
            kept[_block(start, stop, part)] = True
        else:
            kept[start:stop] = short % SHARE == SHARE // 2
            short += 1
    return kept


def _block(start: int, stop: int, part: Part | None) -> slice:
    period, lead = periodicity(part)
    count = (stop - start) // period - lead if period else 0
    if count >= 3:
        first = start + (lead + count // 2) * period
        return slice(first, first + period)
    length = (stop - start) // SHARE
    first = start + 3 * (stop - start) // 5
    return slice(first, first + length)


def periodicity(part: Any) -> tuple[int, int]:
    """Return a part's period in samples and the periods that come first and do not count; 0 where it does not repeat."""
    period = getattr(part, "period", None)
    if not period or abs(period - round(period)) > 1e-9:
        return 0, 0
    return round(period), int(getattr(part, "lead_periods", 0))
