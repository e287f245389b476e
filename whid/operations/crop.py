"""Keep a stretch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge

from whid.errors import WhidError
from whid.operations._operation import Operation, Series


@dataclass(frozen=True, kw_only=True)
class Crop(Operation):
    """Keep the samples start … stop − 1 of all columns.

    Raises `WhidError("data-operation")` when nothing is left.

    >>> import numpy as np
    >>> n = np.arange(5.0)
    >>> Crop(start=1, stop=3).apply(Series(n, n, n, n >= 0), {}).time
    array([1., 2.])
    """

    any_grid: ClassVar[bool] = True
    start: Annotated[int, Ge(0)] = 0
    stop: Annotated[int, Ge(1)] | None = None

    def apply(self, series: Series, scalars: Mapping[str, float]) -> Series:
        """Return the stretch."""
        cut = slice(self.start, self.stop)
        kept = Series(series.time[cut], series.input[cut], series.output[cut], series.valid[cut])
        if len(kept.time) < 2:
            raise WhidError(
                "data-operation", f"crop {self.start} … {self.stop} leaves nothing of {len(series.time)} samples"
            )
        return kept
