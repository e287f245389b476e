"""What is left over and where it lives; what competes and how it ranks: the stages that people and HDF5 see."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats


class ResidualReport(NamedTuple):
    """What the model leaves over, against the noise, and where it lives."""

    rms_estimation: Annotated[float, Quantity("output")]
    rms_selection: Annotated[float, Quantity("output")]
    floor: Annotated[float, Quantity("output")]
    floor_from: str
    ratio: Annotated[float, Quantity("1")]
    p: float
    test: tuple[str, ...]
    statistic: Annotated[Floats, Quantity("1", ("test",))]
    p_test: Annotated[Floats, Quantity("1", ("test",))]
    where: tuple[str, ...]
    raw: tuple[str, ...] = ()  # what the output shows without a model

    def table(self) -> Table:
        """Return one row a test."""
        rows = tuple(zip(self.test, map(float, self.statistic), map(float, self.p_test), self.where, strict=True))
        notes = (
            f"rms {self.rms_estimation:.4g} on estimation, {self.rms_selection:.4g} on selection data; "
            f"noise floor {self.floor:.4g}, {self.floor_from}: ratio {self.ratio:.4g}",
            f"is anything left to explain? p = {self.p:.2g}",
            *self.raw,
        )
        return Table("Residual", ("test", "statistic", "p", "where it lives"), rows, notes)


class Ranking(NamedTuple):
    """Every effect at every place: what screening promised, what a refit reached, what selection data say."""

    effect: tuple[str, ...]
    numbers: Annotated[Floats, Quantity("1", ("effect",))]  # that the effect brings
    tried: Annotated[Floats, Quantity("1", ("effect",))]  # values searched
    penalty: Annotated[Floats, Quantity("nat", ("effect",))]
    screened: Annotated[Floats, Quantity("nat", ("effect",))]  # gain by score, penalty paid
    gain: Annotated[Floats, Quantity("nat", ("effect",))]  # of the joint refit, penalty paid; NaN: not refitted
    selection: Annotated[Floats, Quantity("nat", ("effect",), error="selection_std")]  # gain on selection data
    selection_std: Annotated[Floats, Quantity("nat", ("effect",))]
    against: tuple[str, ...]  # what speaks against a refit; empty: nothing, or not refitted
    taken: str  # what was added; empty: nothing
    margin: Annotated[float, Quantity("nat")]  # to the runner-up
    needed: Annotated[float, Quantity("nat")]

    def table(self) -> Table:
        """Return the ranking, the best first."""
        rows = []
        for k, name in enumerate(self.effect[:12]):
            fitted = bool(np.isfinite(self.gain[k]))
            rows.append(
                (
                    name, round(float(self.screened[k]), 1), round(float(self.gain[k]), 1) if fitted else None,
                    round(float(self.penalty[k]), 1),
                    Measured(float(self.selection[k]), float(self.selection_std[k])) if fitted else None,
                    "added" if name == self.taken else self.against[k],
                )
            )  # fmt: skip
        rest = max(len(self.effect) - 12, 0)
        notes = (
            f"gains in nats of log-likelihood over nothing added, penalties paid; {self.needed:.3g} are needed in all",
            f"margin to the runner-up {self.margin:.3g} nat" if self.taken else "nothing was added",
            *((f"{rest} more in result.h5",) if rest else ()),
        )
        return Table("Ranking", ("effect", "by score", "refitted", "penalty", "gain on selection", ""), tuple(rows), notes)
