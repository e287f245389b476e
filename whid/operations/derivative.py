"""Zero-phase derivative."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt

from whid.errors import WhidError
from whid.operations._operation import ColumnOperation
from whid.operations.lowpass import zero_phase
from whid.signal import Floats

STENCIL = 7  # samples: sixth order, gain error (ωh)⁶/140 of the first derivative


@dataclass(frozen=True, kw_only=True)
class Derivative(ColumnOperation):
    """Differentiate once or twice without phase shift; with cutoff_hz only what lies below it: x → dⁿx/dtⁿ.

    The seven-sample central difference (Savitzky-Golay of full degree), after a zero-phase low-pass where cutoff_hz is
    given. The unit becomes unit/s or unit/s²: declare it under `units`.

    >>> Derivative().values(np.arange(9.0) ** 2, 1.0, {}).round(6)
    array([ 0.,  2.,  4.,  6.,  8., 10., 12., 14., 16.])
    """

    order: Literal[1, 2] = 1
    cutoff_hz: Annotated[float, Gt(0)] | None = None

    def values(self, x: Floats, dt: float, scalars: Mapping[str, float]) -> Floats:
        """Return the derivative."""
        from scipy.signal import savgol_filter

        if len(x) < STENCIL:
            raise WhidError("data-operation", f"derivative needs {STENCIL} samples, not {len(x)}")
        smooth = x if self.cutoff_hz is None else zero_phase(x, dt, self.cutoff_hz)
        return np.asarray(savgol_filter(smooth, STENCIL, STENCIL - 1, deriv=self.order, delta=dt))

    def reach(self, dt: float) -> int:
        """Return half the stencil, and a period of the cutoff frequency."""
        return STENCIL // 2 + (0 if self.cutoff_hz is None else int(np.ceil(1 / (self.cutoff_hz * dt))))
