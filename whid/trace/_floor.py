"""The noise as the data show it without any model: what does not repeat from period to period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from whid.record import Record
from whid.signal import Floats
from whid.stages._whiten import autoregression
from whid.trace._selection import periodicity


class Repeats(NamedTuple):
    """The settled periods of one part."""

    record: int
    start: int
    period: int
    values: Floats  # (periods, period)


def repeats(records: Sequence[Record], signals: Sequence[Floats]) -> Iterator[Repeats]:
    """Yield the complete settled periods, two or more, of every periodic part that is not for the report."""
    for k, (record, y) in enumerate(zip(records, signals, strict=True)):
        for part in record.parts:
            period, lead = periodicity(part)
            if part.use == "report" or not period or part.start is None or part.stop is None:
                continue
            start = part.start + lead * period
            count = (part.stop - start) // period
            values = np.asarray(y[start : start + count * period], float).reshape(count, period) if count > 1 else None
            if values is not None and np.all(np.isfinite(values)):
                yield Repeats(k, start, period, values)


class Floor(NamedTuple):
    """σ of the noise (of one sample), its colour, and the degrees of freedom it was measured with; 0: not measured."""

    std: float
    ar: Floats
    dof: int


def floor(records: Sequence[Record], coloured: bool) -> Floor:
    """Return the scatter of repeated periods about their mean, over all parts."""
    deviations, total, dof = [], 0.0, 0
    for found in repeats(records, [record.y for record in records]):
        count = len(found.values)
        deviation = (found.values - found.values.mean(axis=0)) * np.sqrt(count / (count - 1))
        deviations.append(deviation.ravel())
        total += float(np.sum(deviation**2)) * (count - 1) / count
        dof += found.period * (count - 1)
    if not dof:
        return Floor(float("nan"), np.empty(0), 0)
    every = np.concatenate(deviations)
    ar = autoregression(every, np.ones(len(every), bool)) if coloured else np.empty(0)
    return Floor(float(np.sqrt(total / dof)), ar, dof)
