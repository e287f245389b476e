"""Shift one column against the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from whid.errors import WhidError
from whid.operations._operation import Operation, Series


@dataclass(frozen=True, kw_only=True)
class Lag(Operation):
    """Delay one column by whole samples (negative: advance it): x[n] → x[n − samples].

    The samples at the end that lose their partner are dropped; time stays that of the other column.
    Raises `WhidError("data-operation")` when nothing is left.

    >>> import numpy as np
    >>> n = np.arange(5.0)
    >>> series = Lag(column="output", samples=-2).apply(Series(n, n, n, n >= 0), {})
    >>> series.input, series.output
    (array([0., 1., 2.]), array([2., 3., 4.]))
    """

    column: Literal["input", "output"]
    samples: int

    def apply(self, series: Series, scalars: Mapping[str, float]) -> Series:
        """Return the stretch where both columns are known."""
        n, k = len(series.time), self.samples
        if abs(k) >= n:
            raise WhidError("data-operation", f"lag by {k} samples leaves nothing of {n}")
        other, moved = slice(max(k, 0), n + min(k, 0)), slice(max(-k, 0), n - max(k, 0))
        if self.column == "input":
            return Series(series.time[other], series.input[moved], series.output[other], series.valid[other])
        return Series(series.time[other], series.input[other], series.output[moved], series.valid[moved])
