"""Two results side by side: config, metrics, models; what is only another share of gain between blocks is no difference."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.quantity import Measured
from whid.record import Record
from whid.score import linear_gain
from whid.system import System

Number = float | Measured | None
POINTS = 41  # frequencies and levels at which two models are held against each other


class Tolerance(NamedTuple):
    """What still counts as equal: relative to the larger number, or within so many of their common standard errors."""

    relative: float = 1e-9
    sigma: float = 0.0

    def allows(self, a: float, b: float, std: float = 0.0) -> bool:
        """Tell whether two numbers are equal, NaN and NaN too.

        >>> Tolerance(relative=0.1).allows(1.0, 1.05), Tolerance(sigma=2.0).allows(1.0, 1.3, std=0.1)
        (True, False)
        """
        if np.isnan(a) or np.isnan(b):
            return bool(np.isnan(a) and np.isnan(b))
        return a == b or abs(a - b) <= max(self.relative * max(abs(a), abs(b)), self.sigma * std)


class Difference(NamedTuple):
    """One thing that differs."""

    what: str
    a: Any
    b: Any


def settings(a: Any, b: Any, path: str = "") -> Iterator[Difference]:
    """Yield where two plain values (mappings, lists, scalars) differ, by key.

    >>> list(settings({"seed": 1, "a": [1, 2]}, {"seed": 1, "a": [1, 3]}))
    [Difference(what='a[1]', a=2, b=3)]
    """
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys([*a, *b]):
            yield from settings(a.get(key), b.get(key), f"{path}.{key}" if path else str(key))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from settings(x, y, f"{path}[{k}]")
    elif a != b:
        yield Difference(path, a, b)


def numbers(a: Mapping[str, Number], b: Mapping[str, Number], tolerance: Tolerance) -> Iterator[Difference]:
    """Yield the metrics that differ by more than the tolerance, or that only one of them has."""
    for name in dict.fromkeys([*a, *b]):
        x, y = (side.get(name) for side in (a, b))
        if x is None or y is None:
            yield Difference(name, x, y)
            continue
        (value, error), (other, another) = (m if isinstance(m, Measured) else (m, 0.0) for m in (x, y))
        if not tolerance.allows(value, other, float(np.hypot(error, another))):
            yield Difference(name, x, y)


def models(a: System, b: System, record: Record, tolerance: Tolerance) -> Iterator[Difference]:
    """Yield how far two models are apart whatever their scaling: linear blocks of unit static gain, the static map u → y.

    Frequencies from 1e-3 of the sampling rate to its half, levels over the input's range; a model without a steady state
    has no static map.
    """
    omega = np.geomspace(2e-3, 1.0, POINTS) * np.pi / record.dt
    for side in ("front", "back"):
        gains = linear_gain(a, side, omega), linear_gain(b, side, omega)
        yield from _apart(f"model: {side}, largest |ΔG|", gains, tolerance)
    levels = np.linspace(record.u.min(), record.u.max(), POINTS)
    try:
        first, second = (np.array([s.tree.steady(float(u), record.dt)[0] for u in levels]) for s in (a, b))
    except WhidError:
        return
    yield from _apart("model: static map, largest |Δy|", (first, second), tolerance)


def _apart(what: str, both: tuple[NDArray[Any], NDArray[Any]], tolerance: Tolerance) -> Iterator[Difference]:
    a, b = both
    gap, size = float(np.abs(a - b).max()), float(max(np.abs(a).max(), np.abs(b).max()))
    if not gap <= tolerance.relative * size:
        yield Difference(what, 0.0, gap)
