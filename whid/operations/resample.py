"""Interpolate onto a uniform grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Gt

from whid.errors import WhidError
from whid.operations._operation import Operation, Series
from whid.signal import Floats

Between = Literal["linear", "cubic", "hold"]
HOLE = 2.5  # grid steps without a sample: what lies between is missing, not interpolated
MOST = 10**8


@dataclass(frozen=True, kw_only=True)
class Resample(Operation):
    """Interpolate all columns onto the uniform grid t0 + n·dt (dt: the mean step, holes apart, unless given).

    A held input wants `input: hold`. Outputs inside a hole longer than 2.5 steps are marked missing. Does not
    filter: to go down in rate, resample at about the old rate and `decimate` after it.
    Raises `WhidError("data-operation")` for a dt that asks for more than 1e8 samples.

    >>> t = np.array([0.0, 1.0, 2.2, 3.0])
    >>> Resample(dt=1.0).apply(Series(t, 2 * t, t, t >= 0), {}).input
    array([0., 2., 4., 6.])
    """

    any_grid: ClassVar[bool] = True
    dt: Annotated[float, Gt(0)] | None = None
    input: Between = "linear"
    output: Between = "linear"

    def apply(self, series: Series, scalars: Mapping[str, float]) -> Series:
        """Return the series on the uniform grid."""
        t = series.time
        step = mean_step(t) if self.dt is None else self.dt
        count = (t[-1] - t[0]) / step * (1 + 1e-12) + 1
        if not 2 <= count <= MOST:
            raise WhidError("data-operation", f"resample to dt {step:g} s makes {count:.3g} samples")
        grid = t[0] + step * np.arange(int(count))
        left = np.clip(np.searchsorted(t, grid * (1 + 1e-15), side="right") - 1, 0, len(t) - 2)
        exact = np.isclose(grid, t[left], rtol=0, atol=1e-9 * step) & series.valid[left]
        bridged = (t[left + 1] - t[left] <= HOLE * step) & series.valid[left] & series.valid[left + 1]
        return Series(grid, between(t, series.input, grid, self.input), between(t, series.output, grid, self.output),
                      exact | bridged)  # fmt: skip


def mean_step(t: Floats) -> float:
    """Return the mean step of jittered times, a hole counting as the steps it spans, in no more digits than jitter allows.

    >>> mean_step(np.array([0.0, 0.101, 0.199, 0.302, 0.602, 0.699]))
    0.1
    """
    steps = np.diff(t)
    whole = np.maximum(np.rint(steps / np.median(steps)), 1.0)
    step = float((t[-1] - t[0]) / whole.sum())
    error = float(np.std(steps - whole * step)) / len(steps)
    return next((short for d in range(1, 10) if abs((short := float(f"{step:.{d}g}")) - step) <= 3 * error), step)


def between(t: Floats, x: Floats, grid: Floats, how: Between) -> Floats:
    """Return x, known at the ascending times t, at the times of the grid."""
    if how == "hold":
        return np.asarray(x[np.clip(np.searchsorted(t, grid + 1e-9 * (t[1] - t[0]), side="right") - 1, 0, None)])
    if how == "cubic":
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(t, x)(grid))
    return np.asarray(np.interp(grid, t, x))
