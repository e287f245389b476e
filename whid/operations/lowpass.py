"""Zero-phase low-pass filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from whid.errors import WhidError
from whid.operations._operation import ColumnOperation
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Lowpass(ColumnOperation):
    """Filter forward and backward by a Butterworth low-pass: no phase shift, gain |B(f)|² = 1/(1 + (f/cutoff)^2n).

    The gain at cutoff_hz is ½. Filter input and output alike, or the filter becomes part of the model.
    Raises `WhidError("data-operation")` when the cutoff is not below half the sampling rate.

    >>> Lowpass(cutoff_hz=1.0).values(np.cos(np.pi * np.arange(200)), 0.1, {})[100].round(6) + 0.0
    np.float64(0.0)
    """

    cutoff_hz: Annotated[float, Gt(0)]
    order: Annotated[int, Ge(1), Le(10)] = 4

    def values(self, x: Floats, dt: float, scalars: Mapping[str, float]) -> Floats:
        """Return the filtered column."""
        return zero_phase(x, dt, self.cutoff_hz, self.order)

    def reach(self, dt: float) -> int:
        """Return one period of the cutoff frequency, in samples."""
        return int(np.ceil(1 / (self.cutoff_hz * dt)))


def zero_phase(x: Floats, dt: float, cutoff_hz: float, order: int = 4) -> Floats:
    """Return x filtered forward and backward."""
    from scipy.signal import butter, sosfiltfilt

    if cutoff_hz * dt >= 0.5:
        raise WhidError("data-operation", f"cutoff_hz {cutoff_hz:g} is not below half the sampling rate, {0.5 / dt:g} Hz")
    padding = min(len(x) - 1, max(int(np.ceil(3 / (cutoff_hz * dt))), 3 * order))
    return np.asarray(sosfiltfilt(butter(order, 2 * cutoff_hz * dt, output="sos"), x, padlen=padding))
