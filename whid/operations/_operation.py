"""What every column operation is: series in, series out, nothing hidden."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.kinds import Kind
from whid.signal import Floats


class Series(NamedTuple):
    """The measured columns on their common times; y is filled where it is not valid."""

    time: Floats  # (N,) s
    input: Floats  # (N,)
    output: Floats  # (N,)
    valid: NDArray[np.bool_]  # (N,) False where the output is missing

    @property
    def dt(self) -> float:
        """Return the mean sampling time, s."""
        return float((self.time[-1] - self.time[0]) / max(len(self.time) - 1, 1))


@dataclass(frozen=True, kw_only=True)
class Operation(Kind):
    """One step from raw columns to a Record; operations are applied in the order they are written."""

    family: ClassVar[str] = "whid.operations"
    pointwise: ClassVar[bool] = False  # whether a sample's value hangs on that sample only: it may act on chunks
    any_grid: ClassVar[bool] = False  # whether it may act before the times are known to be uniform

    @abstractmethod
    def apply(self, series: Series, scalars: Mapping[str, float]) -> Series:
        """Return the changed series; `scalars` are the single numbers of the file, by name."""


@dataclass(frozen=True, kw_only=True)
class ColumnOperation(Operation):
    """An operation on the values of one column, or of both."""

    column: Literal["input", "output", "both"] = "both"

    @abstractmethod
    def values(self, x: Floats, dt: float, scalars: Mapping[str, float]) -> Floats:
        """Return the changed column, (N,)."""

    def reach(self, dt: float) -> int:
        """Return over how many samples to either side a missing value spreads."""
        return 0

    def apply(self, series: Series, scalars: Mapping[str, float]) -> Series:
        """Change the named columns; output samples within reach of a missing one are missing too."""
        if self.column != "output":
            series = series._replace(input=self.values(series.input, series.dt, scalars))
        if self.column != "input":
            output = self.values(series.output, series.dt, scalars)
            series = series._replace(output=output, valid=shrunk(series.valid, self.reach(series.dt)))
        return series


def shrunk(valid: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return where every sample within `reach` is valid.

    >>> shrunk(np.array([True, True, True, False, True]), 1)
    array([ True,  True, False, False, False])
    """
    if reach == 0 or valid.all():
        return valid
    missing = np.concatenate([[0], np.cumsum(~valid)])
    n = np.arange(len(valid))
    return np.asarray(missing[np.minimum(n + reach + 1, len(valid))] == missing[np.maximum(n - reach, 0)])
