"""Multiply by a number, or by a scalar that the file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.errors import WhidError
from whid.operations._operation import ColumnOperation
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Scale(ColumnOperation):
    """Multiply by a number, or by a scalar of the file: x → factor·x.

    Exactly one of factor and by. Raises `WhidError("data-operation")` otherwise, `WhidError("data-scalar")` when the
    file has no such scalar.

    >>> Scale(by="gain").values(np.array([1.0, 2.0]), 0.1, {"gain": 3.0})
    array([3., 6.])
    """

    pointwise: ClassVar[bool] = True
    any_grid: ClassVar[bool] = True
    factor: float | None = None
    by: str | None = None

    def __post_init__(self) -> None:
        if (self.factor is None) == (self.by is None):
            raise WhidError("data-operation", "scale needs exactly one of factor, by")

    def values(self, x: Floats, dt: float, scalars: Mapping[str, float]) -> Floats:
        """Return the scaled column."""
        if self.factor is not None:
            return np.asarray(x * self.factor)
        if self.by is None or self.by not in scalars:
            raise WhidError("data-scalar", f"scale by {self.by!r}: the file's scalars are {', '.join(scalars) or 'none'}")
        return np.asarray(x * scalars[self.by])
