"""The lattice on which a converter puts its values."""

from __future__ import annotations

import numpy as np

from whid.signal import Floats


def lattice(y: Floats) -> float | None:
    """Return the step of which all values are multiples, None where they come in no steps.

    >>> round(lattice(0.25 * np.round(np.random.default_rng(0).standard_normal(500) / 0.25)), 9)
    0.25
    """
    values = np.unique(y)
    if len(values) < 3 or len(values) > len(y) / 3:
        return None
    steps = np.diff(values)
    step = float(steps.min())
    if not step > 1e-9 * np.abs(values).max():
        return None
    count = np.round((values - values[0]) / step)
    step = float((values[-1] - values[0]) / count[-1])
    off = np.abs((values - values[0]) / step - np.round((values - values[0]) / step))
    return step if off.max() < 0.02 else None
