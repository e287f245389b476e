"""The noise as the data show it without any model: what does not repeat from period to period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from whid.record import Record
from whid.signal import Floats
from whid.stages._whiten import autoregression
from whid.trace._selection import periodicity

MEMORY = 2000  # samples after which a colour's echo is gone
UNSETTLED = 1e-3  # chance of as large a difference of a first period from the others, below which it has not settled


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

    @property
    def innovation(self) -> float:
        """Return σ of what drives the noise: white, when its colour is taken off.

        >>> round(Floor(1.0, np.array([0.6]), 100).innovation, 3)
        0.8
        """
        from scipy.signal import lfilter

        echo = lfilter([1.0], [1.0, *(-self.ar)], np.eye(1, MEMORY)[0])
        return float(self.std / np.linalg.norm(echo))


def floor(records: Sequence[Record], coloured: bool) -> Floor:
    """Return the scatter of repeated periods about their mean, over all parts, once they have settled."""
    deviations, total, dof = [], 0.0, 0
    for found in repeats(records, [record.y for record in records]):
        values = settled(found.values)
        count = len(values)
        deviation = (values - values.mean(axis=0)) * np.sqrt(count / (count - 1))
        deviations.append(deviation.ravel())
        total += float(np.sum(deviation**2)) * (count - 1) / count
        dof += found.period * (count - 1)
    if not dof:
        return Floor(float("nan"), np.empty(0), 0)
    every = np.concatenate(deviations)
    ar = autoregression(every, np.ones(len(every), bool)) if coloured else np.empty(0)
    return Floor(float(np.sqrt(total / dof)), ar, dof)


def settled(values: Floats) -> Floats:
    """Return periods (P, n) without the first ones that differ from what follows more than the rest does in itself.

    F = m/(m + 1)·Σ (first − mean)²/n over the variance of the m periods behind it. What goes before a part rings on into its
    first period, and would pass for noise. Two periods stay in any case.

    >>> rng = np.random.default_rng(0)
    >>> e = rng.standard_normal((6, 200))
    >>> settled(e).shape, settled(e + [np.exp(-np.arange(200) / 10) * 5 * (k == 0) for k in range(6)]).shape
    ((6, 200), (5, 200))
    """
    from scipy.stats import f

    while len(values) > 2:
        first, rest = values[0], values[1:]
        m, n = rest.shape
        ratio = m / (m + 1) * np.mean((first - rest.mean(axis=0)) ** 2) / max(np.mean(np.var(rest, axis=0, ddof=1)), 1e-300)
        if f.sf(ratio, n, n * (m - 1)) > UNSETTLED:
            break
        values = rest
    return values
