"""A small simulated study and a small method, for the tests of everything around a method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np

from whid.blocks.dead_zone import DeadZone
from whid.blocks.linear import Linear
from whid.config.study import Bound, Study
from whid.disturbances.white import White
from whid.errors import WhidError
from whid.experiments._experiment import Adaptive, Experiment
from whid.experiments.hold import Hold
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.fit import Estimate, linear_least_squares
from whid.methods._method import Method, Model, Stages, Wanted
from whid.quantity import Measured, Quantity, Table
from whid.record import Record
from whid.signal import Floats
from whid.system import System

PLANT = System(
    chain=(Linear(num=(1.0,), den=(0.2, 1.0)), DeadZone(low=-0.5, high=0.5), Linear(num=(1.0,), den=(0.1, 1.0))),
    noise=(White(std=0.05),),
)
EXPERIMENT = Experiment(
    dt=0.05,
    adaptive=Adaptive(),
    parts=(
        Staircase(from_=-2.0, to=2.0, step=0.5, hold_s=5.0, return_=True),
        Sine(offset=1.0, amplitude=0.8, samples_per_period=(80.0, 40.0), periods=6),
        Hold(level=1.5, hold_s=4.0, use="report"),
    ),
)


class Levels(NamedTuple):
    """Mean output of every hold."""

    level: Annotated[Floats, Quantity("input", ("level",))]
    mean: Annotated[Floats, Quantity("output", ("level",), error="mean_std")]
    mean_std: Annotated[Floats, Quantity("output", ("level",))]
    reached: Annotated[tuple[str, ...], Quantity(dims=("level",))]
    slope: Annotated[float, Quantity("output/input")]
    response: Annotated[np.ndarray, Quantity("output/input", ("level",))]  # complex
    rising: np.ndarray  # truth values
    fit: Estimate
    count: int
    absent: float | None = None

    def table(self) -> Table:
        """Return one row a level."""
        rows = zip(self.level, self.mean, self.mean_std, strict=True)
        return Table("Levels", ("level", "mean"), tuple((float(u), Measured(float(y), float(s))) for u, y, s in rows))


@dataclass(frozen=True, kw_only=True)
class SmallStudy(Method):
    """Level means, a straight line through them, one experiment asked for; then the plant itself as model."""

    fail: str = ""
    wants: bool = True

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield Levels (twice if its wish is granted), then the Model."""
        yield levels(records[0])
        if self.fail:
            raise {"named": WhidError("block-no-steady-state", "an integrator"), "bug": ZeroDivisionError("a bug"),
                   "stopped": KeyboardInterrupt()}[self.fail]  # fmt: skip
        more = (yield Wanted((Hold(level=0.25, hold_s=5.0),), "a level inside the dead zone", 0.01)) if self.wants else None
        if more is not None:
            yield levels(more)
        names = [p.name for p in PLANT.tree.parameters()]
        values = np.array([p.value for p in PLANT.tree.parameters()])
        noisy = np.eye(len(values)), values, np.full(len(values), 100.0)
        yield Model(PLANT, linear_least_squares(*noisy, names=names), "unit_dc", ("a delay",))


def levels(record: Record) -> Levels:
    """Return the mean of the second half of every hold that may be seen, and a straight line through them."""
    holds = [part for part in record.parts if part.kind == "hold" and part.use == "estimation"]
    halves = [record.y[part.start : part.stop][part.length // 2 :] for part in holds]
    u = np.array([part.level for part in holds])  # type: ignore[attr-defined]
    mean, std = np.array([h.mean() for h in halves]), np.array([h.std() / len(h) ** 0.5 for h in halves])
    fit = linear_least_squares(np.stack([np.ones_like(u), u], axis=1), mean, 1 / std, ("offset", "slope"))
    return Levels(
        u, mean, std, tuple(p.direction or "" for p in holds), float(fit.values[1]), mean * (1 + 1j), u > 0, fit, len(u)
    )  # type: ignore[attr-defined]  # fmt: skip


def small_study(**changes: Any) -> Study:
    """Return the study, some of its fields changed."""
    given: dict[str, Any] = {
        "name": "small",
        "seed": 7,
        "plant": PLANT,
        "experiment": (EXPERIMENT,),
        "identify": SmallStudy(),
    }
    return Study(**(given | changes))


def bound(metric: str, below: float) -> Bound:
    """Return one line of `expect:`."""
    return Bound(metric=metric, below=below)
