"""The way down: what each step of a fit used and what it left."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Quantity, Table
from whid.signal import Floats

Counts = NDArray[np.intp]


class Descent(NamedTuple):
    """Descent of filter, curve, filter: more data, more knots, a finer grid, step by step."""

    samples: Annotated[Counts, Quantity(dims=("step",))]
    rate: Annotated[Counts, Quantity(dims=("step",))]  # times the record's
    knots: Annotated[Counts, Quantity(dims=("step",))]
    rms: Annotated[Floats, Quantity("output", dims=("step",))]
    iterations: Annotated[Counts, Quantity(dims=("step",))]
    seconds: Annotated[Floats, Quantity("s", dims=("step",))]  # of one iteration
    why_stop: tuple[str, ...]

    def table(self) -> Table:
        """Return one row a step."""
        rows = tuple(
            (int(n), int(r), int(k), float(f"{e:.5g}"), int(i), float(f"{1e3 * s:.3g}"), why)
            for n, r, k, e, i, s, why in zip(*self, strict=True)
        )
        columns = ("samples", "× rate", "curve numbers", "rms", "iterations", "ms each", "stopped")
        return Table("Descent", columns, rows)


class Step(NamedTuple):
    """One step of a descent."""

    samples: int
    rate: int
    knots: int
    rms: float
    iterations: int
    seconds: float
    why_stop: str


def descent(steps: list[Step]) -> Descent:
    """Return the steps as columns."""
    samples, rate, knots, rms, iterations, seconds = (np.array(c) for c in zip(*(step[:-1] for step in steps), strict=True))
    return Descent(samples, rate, knots, rms, iterations, seconds, tuple(step.why_stop for step in steps))
