"""Add a constant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.operations._operation import ColumnOperation
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Offset(ColumnOperation):
    """Add a constant, in the column's unit: x → x + value.

    >>> Offset(value=-1.0).values(np.array([1.0, 2.0]), 0.1, {})
    array([0., 1.])
    """

    pointwise: ClassVar[bool] = True
    any_grid: ClassVar[bool] = True
    value: float

    def values(self, x: Floats, dt: float, scalars: Mapping[str, float]) -> Floats:
        """Return the shifted column."""
        return np.asarray(x + self.value)
