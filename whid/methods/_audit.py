"""Which of several values of the input nonlinearity is the true one: every reading simulated against all records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.methods._method import Model
from whid.quantity import Quantity, Table
from whid.record import Record
from whid.residual import residual
from whid.signal import Floats

DECIDED = 12.0  # χ² by which the best reading must be ahead


class Audit(NamedTuple):
    """Audit: the readings of the input nonlinearity that the levels cannot tell apart, and what all samples say of them."""

    value: Annotated[Floats, Quantity("input", ("reading", "piece"))]  # of each piece at its centre
    slope: Annotated[Floats, Quantity("1", ("reading", "piece"))]
    chi2: Annotated[Floats, Quantity("1", ("reading",))]  # above the best
    squares: int  # square-wave parts in the records
    decided: bool

    @property
    def chosen(self) -> int:
        """Return the best reading."""
        return int(np.argmin(self.chi2))

    def table(self) -> Table:
        """Return one row a reading."""
        rows = tuple(
            (", ".join(f"{v:.4g}" for v in values), float(f"{c:.4g}"))
            for values, c in zip(self.value, self.chi2, strict=True)
        )
        by = "square waves and all other records" if self.squares else "the transients of all records"
        note = f"decided by {by}" if self.decided else "not decided: a square wave between two pieces tells them apart"
        return Table("Audit of the pieces", ("x on the pieces", "χ² above the best"), rows, (note,))


def audit(models: Sequence[Model], values: Floats, slopes: Floats, records: Sequence[Record]) -> Audit:
    """Return Σ (y − ŷ)²/σ² of every reading, σ² from the best; steady levels fit alike, transients do not.

    Source [Brouri2014], eq. (26) and what follows; simulated whole, since the fundamental alone needs G at 3ω, 5ω … too.
    """
    squares = np.array([sum(_square(model, record) for record in records) for model in models])
    samples = sum(int(record.using("estimation").sum()) for record in records)
    chi2 = (squares - squares.min()) / (squares.min() / samples)
    waves = sum(1 for record in records for _ in record.select("square"))
    return Audit(values, slopes, chi2, waves, bool(np.sum(chi2 < DECIDED) == 1))


def _square(model: Model, record: Record) -> float:
    left = residual(model.system.tree, record)[record.using("estimation")]
    return float(np.nansum(left**2))
