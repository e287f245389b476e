"""Steps of random or listed levels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, MinLen

from whid.errors import WhidError
from whid.experiments._part import Part
from whid.signal import Floats

Positive = Annotated[float, Gt(0)]


@dataclass(frozen=True, kw_only=True)
class Steps(Part):
    """A level, held for a while, then another: random levels in [low, high], or the listed ones over and over.

    u(t) = U_k for a hold time drawn from hold_s = [shortest, longest] (one number: always that), for duration_s in all.
    Raises `WhidError("part-parameters")` unless either levels, or low and high, are given. A part of a record that was
    found there needs neither: start and stop say where it is.

    >>> Steps(levels=(0.0, 2.0), hold_s=0.2, duration_s=0.5).input(0.1, np.random.default_rng(0))
    array([0., 0., 2., 2., 0.])
    """

    levels: Annotated[tuple[float, ...], MinLen(1)] | None = None
    low: float | None = None
    high: float | None = None
    hold_s: Positive | tuple[Positive, Positive] | None = None
    duration_s: Positive | None = None

    def __post_init__(self) -> None:
        if self.start is not None:
            return
        if self.hold_s is None or self.duration_s is None:
            raise WhidError("part-parameters", "planned steps need hold_s and duration_s")
        if (self.levels is None) == (self.low is None) or (self.low is None) != (self.high is None):
            raise WhidError("part-parameters", "steps need either levels, or low and high")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise WhidError("part-parameters", f"steps need low <= high, not {self.low:g} > {self.high:g}")
        shortest, longest = self._holds()
        if shortest > longest:
            raise WhidError("part-parameters", f"hold_s is [shortest, longest], not [{shortest:g}, {longest:g}]")

    def samples(self, dt: float) -> int:
        """Return duration_s in samples, or the length of the stretch found in a record."""
        return self.length if self.duration_s is None else max(1, round(self.duration_s / dt))

    def input(self, dt: float, rng: np.random.Generator) -> Floats:
        """Return the steps."""
        return self.stretch(dt, rng)(0, self.samples(dt))

    def stretch(self, dt: float, rng: np.random.Generator) -> Callable[[int, int], Floats]:
        """Return any stretch of the steps; a stream of numbers for the times, one for the levels: each repeats by itself."""
        times, levels = rng.spawn(2)
        n, (shortest, longest) = self.samples(dt), self._holds()
        count = int(np.ceil(n / max(1, int(shortest / dt))))
        holds = np.maximum(1, np.round(times.uniform(shortest, longest, count) / dt)).astype(int)
        if self.levels is None:
            u = levels.uniform(self.low or 0.0, self.high or 0.0, count)
        else:
            u = np.resize(np.asarray(self.levels, float), count)
        ends = np.cumsum(holds)

        def steps(first: int, last: int) -> Floats:
            a, b = np.searchsorted(ends, (first, last - 1), side="right")
            edges = np.clip(ends[a : b + 1], first, last)
            return np.repeat(u[a : b + 1], np.diff(edges, prepend=first))

        return steps

    def numbers(self, dt: float) -> int:
        """Return those of every hold, and what drawing them needs."""
        return 6 * int(np.ceil(self.samples(dt) / max(1, int(self._holds()[0] / dt))))

    def _holds(self) -> tuple[float, float]:
        hold = 0.0 if self.hold_s is None else self.hold_s
        return hold if isinstance(hold, tuple) else (hold, hold)
