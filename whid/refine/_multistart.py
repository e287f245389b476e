"""Several fits from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np

from whid.blocks.chain import Chain
from whid.errors import WhidError
from whid.quantity import Quantity, Table
from whid.record import Record
from whid.refine._fit import refine
from whid.refine._free import FreeNumbers
from whid.refine._result import Refined
from whid.signal import Floats
from whid.system import System

DRAWS = 100  # of one scattered start


class Starts(NamedTuple):
    """Several fits from several starts: the best, and where the others ended."""

    best: Refined
    cost: Annotated[Floats, Quantity("1", ("start",))]  # Σ samples·log σ² of each, the best 0
    agreeing: int  # starts that ended as low as the best, to 1 in χ²

    def table(self) -> Table:
        """Return where every start ended."""
        rows = tuple((k + 1, float(c)) for k, c in enumerate(self.cost))
        return Table("Starts", ("start", "−2 log L above the best"), rows, (f"{self.agreeing} of {len(rows)} agree",))


def multistart(
    system: System, records: Sequence[Record], starts: int, rng: np.random.Generator, spread: float = 0.3,
    **options: Any,
) -> Starts:  # fmt: skip
    """Fit from the given numbers and from `starts` − 1 scattered ones (each times exp(spread·normal)), keep the best.

    What holds a gauge stays; ties and kinks stay such. A scatter that makes no model (breaks out of order) is drawn again.
    A start that cannot be simulated counts as one that ended nowhere (infinite cost). options: those of `refine`.
    """
    first = refine(system, records, **options)
    found: list[Refined | None] = [first]
    held = tuple(p.name for p in system.tree.parameters() if p.name not in first.estimate.names)
    free = FreeNumbers(system.tree, held, tuple(tuple(group) for group in options.get("tied", ())))
    for _ in range(starts - 1):
        try:
            found.append(refine(replace(system, chain=scattered(free, rng, spread).chain), records, **options))
        except (WhidError, ValueError, np.linalg.LinAlgError):
            found.append(None)
    cost = np.array([np.inf if f is None else float(f.samples @ np.log(np.maximum(f.noise_std, 1e-300)) * 2) for f in found])
    best = found[int(np.nanargmin(cost))]
    assert best is not None
    cost -= np.nanmin(cost)
    return Starts(best, cost, int(np.sum(cost < 1.0)))


def scattered(free: FreeNumbers, rng: np.random.Generator, spread: float) -> Chain:
    """Return the tree at free numbers times exp(spread·normal) each; raise `WhidError("fit-start")` where none is one."""
    for _ in range(DRAWS):
        numbers = [np.clip(p.value * np.exp(spread * rng.standard_normal()), p.lower, p.upper) for p in free.parameters]
        try:
            tree = free.at(np.array(numbers, float))
            break
        except WhidError:
            continue
    else:
        raise WhidError("fit-start", f"{DRAWS} scattered starts made no model")
    assert isinstance(tree, Chain)
    return tree
