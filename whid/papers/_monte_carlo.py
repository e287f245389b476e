"""Figures of a Monte Carlo with their standard errors, and bars that hold when a figure's interval reaches them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Measured
from whid.result import Check

Z = 1.96  # of a 95 % interval


def finite(values: Any) -> NDArray[np.float64]:
    """Return the values without those of runs that failed."""
    kept = np.asarray(values, float).ravel()
    return np.asarray(kept[np.isfinite(kept)])


def mean(values: Any) -> Measured:
    """Return the mean over runs.

    >>> mean([1.0, 2.0, 3.0])
    Measured(value=2.0, std=0.5773502691896258)
    """
    x = finite(values)
    return Measured(float(x.mean()), float(x.std(ddof=1) / np.sqrt(len(x)))) if len(x) > 1 else Measured(*[np.nan] * 2)


def rmse(errors: Any) -> Measured:
    """Return √(mean e²) over runs; its standard error is rmse/√(2n) for Gaussian errors."""
    e = finite(errors)
    size = float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")
    return Measured(size, size / np.sqrt(2 * len(e)) if len(e) else float("nan"))


def variance(values: Any) -> Measured:
    """Return the variance over runs; its standard error is s²·√(2/(n − 1)) for Gaussian values."""
    x = finite(values)
    size = float(x.var(ddof=1)) if len(x) > 1 else float("nan")
    return Measured(size, size * np.sqrt(2 / (len(x) - 1)) if len(x) > 1 else float("nan"))


def share(true: int, of: int) -> Measured:
    """Return a share of runs with its binomial standard error (at least that of half a run, so that 0 of n is not exact)."""
    p = true / of
    return Measured(p, float(np.sqrt(max(p * (1 - p), 0.5 / of * (1 - 0.5 / of)) / of)))


def held(metric: str, figure: Measured, below: float | None = None, above: float | None = None) -> Check:
    """Return a bar as a Check of the point of the figure's 95 % interval that is nearest to what the bar allows.

    >>> held("RMSE", Measured(3.1e-3, 1e-4), below=3e-3).verdict, held("RMSE", Measured(3.4e-3, 1e-4), below=3e-3).verdict
    ('pass', 'breached')
    """
    value, reach = figure.value, Z * (figure.std if np.isfinite(figure.std) else 0.0)
    if below is not None and value >= below:
        value = max(value - reach, min(value, np.nextafter(below, -np.inf)))
    if above is not None and value <= above:
        value = min(value + reach, max(value, np.nextafter(above, np.inf)))
    return Check(metric, float(value), below, above)
