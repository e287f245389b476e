"""The static curves of a fitted cascade as points with errors, over the levels that arrived."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.blocks._static import Static
from whid.fit import Estimate
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._cascade import Cascade
from whid.stages.cascade_fit import Window, reached

POINTS = 201


class StaticCurves(NamedTuple):
    """Levels at each curve, the curve there and its standard error; blocks behind one another without a filter are one."""

    level: Annotated[Floats, Quantity("input", ("curve", "point"))]
    value: Annotated[Floats, Quantity("output", ("curve", "point"), error="std")]
    std: Annotated[Floats, Quantity("output", ("curve", "point"))]

    def table(self) -> Table:
        """Return ends and middle of every curve."""
        rows = [
            (k + 1, float(f"{self.level[k, p]:.4g}"), Measured(float(self.value[k, p]), float(self.std[k, p])))
            for k in range(len(self.level))
            for p in (0, POINTS // 4, POINTS // 2, 3 * POINTS // 4, POINTS - 1)
        ]
        return Table("Static curves", ("curve", "level", "value"), tuple(rows))


def static_curves(windows: Sequence[Window], cascade: Cascade, estimate: Estimate) -> StaticCurves:
    """Return every curve at evenly spaced levels, std from the covariance of its own numbers."""
    spans, rows = iter(reached(windows, cascade)), []
    column = np.cumsum(cascade.free) - 1  # of a value's place among the free
    for group in _groups(cascade):
        levels = np.linspace(*next(spans), POINTS)
        _ = [next(spans) for _ in group[1:]]
        x, rates, places = levels, np.empty((0, POINTS)), np.empty(0, np.intp)
        for place in group:
            part, at = list(cascade.places())[place]
            assert isinstance(part, Static)
            through, own = Cascade((part,)).tangents(x)
            rates = np.vstack([rates * part.derivative(x), own])
            x, places = through, np.append(places, np.arange(at.start, at.stop))
        kept = cascade.free[places]
        own_covariance = estimate.covariance[np.ix_(column[places[kept]], column[places[kept]])]
        variance = np.einsum("pv,pq,qv->v", rates[kept], own_covariance, rates[kept])
        rows.append((levels, x, np.sqrt(np.maximum(variance, 0.0))))
    return StaticCurves(*(np.array(column) for column in zip(*rows, strict=True)))


def _groups(cascade: Cascade) -> list[list[int]]:
    """Return the places of curves that follow one another."""
    groups: list[list[int]] = []
    for k, part in enumerate(cascade.parts):
        if isinstance(part, Static):
            if groups and groups[-1][-1] == k - 1:
                groups[-1].append(k)
            else:
                groups.append([k])
    return groups
