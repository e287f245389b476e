"""Take a polynomial trend away."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from whid.operations._operation import ColumnOperation
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Detrend(ColumnOperation):
    """Subtract the least-squares polynomial in time; degree 0 is the mean: x → x − p(t).

    The level goes with it: a nonlinear model needs absolute levels, so rather name the drift as a disturbance.

    >>> Detrend().values(np.arange(5.0), 0.1, {}).round(9) + 0.0
    array([0., 0., 0., 0., 0.])
    """

    degree: Annotated[int, Ge(0), Le(20)] = 1

    def values(self, x: Floats, dt: float, scalars: Mapping[str, float]) -> Floats:
        """Return what the polynomial leaves."""
        from numpy.polynomial import chebyshev

        t = np.linspace(-1.0, 1.0, len(x))
        return np.asarray(x - chebyshev.chebval(t, chebyshev.chebfit(t, x, min(self.degree, len(x) - 1))))
