"""The experiment plan of a simulated study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, MinLen

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Adaptive:
    """What a method may ask for beyond the plan: so many experiments (a hold, a sine, …), so many samples in all."""

    max_experiments: Annotated[int, Ge(1)] = 50
    max_samples: Annotated[int, Ge(1)] = 200_000


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Parts one after another on one grid, from one initial state.

    dt          sampling time, s
    intersample what the input does between samples
    initial     state before the first sample: rest, or steady at the first input
    adaptive    what the method may ask for in addition, of the plant as here; left out: nothing
    path        exact: blocks act between samples, hard nonlinearities switch where they switch; sampled: at samples only
    """

    dt: Annotated[float, Gt(0)]
    parts: Annotated[tuple[Part, ...], MinLen(1)]
    intersample: Literal["zoh", "foh", "bandlimited", "discrete"] = "zoh"
    initial: Literal["rest", "steady"] = "rest"
    path: Literal["exact", "sampled"] = "exact"
    adaptive: Adaptive | None = None
    name: str = "record"

    def __post_init__(self) -> None:
        for k, part in enumerate(self.parts):
            try:
                part.expand(self.dt)
            except WhidError as fault:
                raise WhidError(fault.code, fault.message, f"parts.{k}") from None

    def plan(self) -> tuple[Part, ...]:
        """Return the expanded parts, each at its place."""
        placed, start = [], 0
        for part in (single for whole in self.parts for single in whole.expand(self.dt)):
            placed.append(part.placed(start, self.dt))
            start = placed[-1].stop or 0
        return tuple(placed)

    def samples(self) -> int:
        """Return the length of the whole plan without making it."""
        return self.plan()[-1].stop or 0

    def input(self, plan: tuple[Part, ...], rng: np.random.Generator) -> Floats:
        """Return u of a plan."""
        return np.concatenate([part.input(self.dt, rng) for part in plan])
