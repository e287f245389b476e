"""The holds of records as visits of levels, and their static curves as one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from whid.record import Record
from whid.signal import Floats
from whid.stages.levels import StaticCurve


class Visit(NamedTuple):
    """One hold of a record."""

    level: float
    direction: float  # +1 from below, −1 from above, 0 unknown
    y: Floats  # NaN where missing
    dt: float


def visits(records: Sequence[Record]) -> list[Visit]:
    """Return the estimation holds of all records."""
    found = []
    for record in records:
        y = np.where(record.mask, record.y, np.nan)
        for part in record.select("hold"):
            way = {"up": 1.0, "down": -1.0}.get(part.direction or "", 0.0)  # type: ignore[attr-defined]
            found.append(Visit(float(part.level), way, y[part.start : part.stop], record.dt))  # type: ignore[attr-defined]
    return found


def by_rate(found: Sequence[Visit]) -> dict[float, list[Visit]]:
    """Return the visits of each sampling time, the one with most visits first."""
    rates = sorted({v.dt for v in found}, key=lambda dt: -sum(v.dt == dt for v in found))
    return {dt: [v for v in found if v.dt == dt] for dt in rates}


def joined(curves: Sequence[StaticCurve]) -> StaticCurve:
    """Return all levels as one curve; what describes the noise is that of the first."""
    every = zip(*((c.level, c.mean, c.mean_std, c.direction, c.samples, c.drifting) for c in curves), strict=True)
    level, mean, std, direction, samples, drifting = map(np.concatenate, every)
    return curves[0]._replace(level=level, mean=mean, mean_std=std, direction=direction, samples=samples, drifting=drifting)
