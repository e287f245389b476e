"""The error of a model on one use of the data, with intervals that allow for coloured residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whid.record import Record
from whid.residual import residual
from whid.signal import Floats, rms
from whid.system import System
from whid.trace._verdict import Errors

BLOCKS = 20  # whose mean squares scatter as the interval says


def measured(system: System, records: Sequence[Record], use: str, floor: float, path: str) -> Errors:
    """Return rms, its 95 % interval, nrmse, fit and ratio to the noise floor.

    nrmse = rms/std(y), fit = 100(1 − nrmse). The interval is that of the mean of the squares over 20 blocks.
    """
    errors, spread = [], []
    for record in records:
        on = record.using(use)
        if on.any():
            errors.append(residual(system.tree, record, path)[on])
            spread.append(record.y[on] - record.y[on].mean())
    error, size = np.concatenate(errors), rms(np.concatenate(spread))
    found = rms(error)
    half = _standard_error(error) * 1.96 / (2 * found) if found > 0 else 0.0
    nrmse = found / size if size > 0 else float("nan")
    return Errors(found, max(found - half, 0.0), found + half, nrmse, 100 * (1 - nrmse), found / floor)


def _standard_error(error: Floats) -> float:
    """Return the standard error of the mean square."""
    squares = error[np.isfinite(error)] ** 2
    if len(squares) < 2 * BLOCKS:
        return float(np.std(squares) / np.sqrt(max(len(squares), 1)))
    means = [block.mean() for block in np.array_split(squares, BLOCKS)]
    return float(np.std(means, ddof=1) / np.sqrt(BLOCKS))
