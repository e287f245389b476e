"""Fit: the declared model, all its free numbers to all estimation samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge

from whid.errors import WhidError
from whid.methods._method import Method, Model, Stages
from whid.record import Record
from whid.refine import multistart, refine
from whid.system import System


@dataclass(frozen=True, kw_only=True)
class Fit(Method):
    """The declared model, all its free numbers fitted to all estimation samples at once.

    min Σ (y − ŷ)²/σ², ŷ simulated. The model's structure counts, its numbers are start values; `fix:` holds some.

    noise    white, or ar: an autoregression of the residual, prewhitened
    robust   Huber's loss
    tied     groups of numbers with one common value, by path: [[chain.0.den.0, chain.2.den.0]]
    starts   fits from scattered starts, the given one included; the best is kept (drawn with `seed`)
    steps    iterations at most; 0: the numbers stay as they are given, their errors are told
    path     exact between samples, or sampled
    """

    noise: Literal["white", "ar"] = "white"
    robust: bool = False
    tied: tuple[tuple[str, ...], ...] = ()
    starts: Annotated[int, Ge(1)] = 1
    steps: Annotated[int, Ge(0)] = 60
    seed: Annotated[int, Ge(0)] = 0
    path: Literal["exact", "sampled"] = "exact"

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield the fit (of several, their costs first), the Model last."""
        if model is None:
            raise WhidError("fit-no-model", "nothing to fit: the config has no `model:`")
        options: dict[str, Any] = {
            "noise": self.noise,
            "robust": self.robust,
            "tied": self.tied,
            "path": self.path,
            "watch": self.told,
            "max_iterations": self.steps,
        }
        if self.starts > 1:
            several = multistart(model, records, self.starts, np.random.default_rng(self.seed), **options)
            yield several
            found = several.best
        else:
            found = refine(model, records, **options)
            if not self.steps:
                found = found._replace(estimate=found.estimate._replace(why_stop="not fitted"))
            yield found
        yield Model(found.system, found.estimate, "none", found.gauge)
        if found.estimate.why_stop == "interrupted":
            raise KeyboardInterrupt

    def told(self, iteration: int, cost: float) -> None:
        """Follow the fit: called after every accepted step with χ² per sample; nothing here listens."""
