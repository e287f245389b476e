"""What every regenerated table or figure is: keys, runs of its study, rows in the same columns."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, MinLen

from whid.experiments._experiment import Experiment
from whid.kinds import Kind
from whid.methods._method import Method
from whid.quantity import Cell, Measured, Table
from whid.result import Check, Result
from whid.signal import Floats
from whid.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("published", "paper", "efficient", "bound")
HEADINGS = ("published", "paper's method, ours", "efficient, ours", "bound")


class Row(NamedTuple):
    """One line of a table; `tolerance` is what `--check` lets its numbers move by, left out: their standard errors."""

    quantity: str
    published: Cell = None
    paper: Cell = None
    efficient: Cell = None
    bound: Cell = None
    tolerance: float | None = None


class Regenerated(NamedTuple):
    """A table or figure: rows, remarks, bars with what was reached, and how it is drawn."""

    title: str
    rows: Sequence[Row]
    notes: tuple[str, ...] = ()
    bars: tuple[Check, ...] = ()
    draw: Callable[[Figure], None] | None = None
    headings: tuple[str, str, str, str] = HEADINGS

    def table(self) -> Table:
        """Return the rows as people read them, without the columns that are empty.

        >>> Regenerated("Table 1", [Row("gain", 0.98, efficient=Measured(0.979, 0.001))]).table().columns
        ('quantity', 'published', 'efficient, ours')
        """
        kept = [k for k, name in enumerate(COLUMNS) if any(getattr(row, name) is not None for row in self.rows)]
        rows = tuple((row.quantity, *(getattr(row, COLUMNS[k]) for k in kept)) for row in self.rows)
        return Table(self.title, ("quantity", *(self.headings[k] for k in kept)), rows, self.notes)


@dataclass(frozen=True)
class Bench:
    """The study of a table, and what runs it."""

    plant: System | None
    experiments: tuple[Experiment, ...]
    method: Method
    seed: int
    runs: int
    full: bool
    execute: Callable[[Mapping[str, Any], int], Result]  # what changes in the study, number of the run
    generator: Callable[[Sequence[int]], np.random.Generator]
    watch: Callable[[int, int], None] = lambda done, of: None
    failures: list[str] = field(default_factory=list)

    def results(self, count: int | None = None, **changes: Any) -> Iterator[Result]:
        """Yield runs of the study with some of its fields changed; run k draws the same noise whatever `count` is."""
        count = self.runs if count is None else count
        for repeat in range(count):
            found = self.execute(changes, repeat)
            if found.error:
                self.failures.append(f"run {repeat} failed: {found.error.code}: {found.error.message}")
            yield found
            self.watch(repeat + 1, count)

    def metrics(self, count: int | None = None, **changes: Any) -> dict[str, Floats]:
        """Return the metrics of such runs by name, (runs, 2): value and standard error, NaN where there is none."""
        found = [dict(result.metrics) if not result.error else {} for result in self.results(count, **changes)]
        nothing = Measured(np.nan, np.nan)
        names = dict.fromkeys(name for metrics in found for name in metrics)
        return {name: np.array([_pair(metrics.get(name, nothing)) for metrics in found]) for name in names}

    def rng(self, *key: int) -> np.random.Generator:
        """Return a generator of its own for a key, the same at every call."""
        return self.generator(key)


@dataclass(frozen=True, kw_only=True)
class Published:
    """One printed number: of what, its value, and the truth that the paper gives for it."""

    quantity: Annotated[str, MinLen(1)]
    value: float | None = None
    truth: float | None = None


@dataclass(frozen=True, kw_only=True)
class Exhibit(Kind):
    """A table or figure of a paper, made anew from the study it stands in.

    runs       of the study, quick enough for `whid table --all`
    full_runs  of `whid table --full`, the count of the bar; left out: runs
    published  what the paper printed
    """

    family: ClassVar[str] = "whid.papers"
    runs: Annotated[int, Ge(1)] = 1
    full_runs: Annotated[int, Ge(1)] | None = None
    published: tuple[Published, ...] = ()

    def __call__(self, bench: Bench) -> Regenerated:
        """Return it, with a note for the runs that failed."""
        found = self.regenerate(bench)
        failed = (f"{len(bench.failures)} runs failed and are left out; {bench.failures[0]}",) if bench.failures else ()
        return found._replace(notes=found.notes + failed)

    @abstractmethod
    def regenerate(self, bench: Bench) -> Regenerated:
        """Return the rows, and the picture if it is a figure."""

    def printed(self, quantity: str) -> float | None:
        """Return the printed value of a quantity, None where the paper has none."""
        return next((row.value for row in self.published if row.quantity == quantity), None)


def _pair(metric: float | Measured) -> tuple[float, float]:
    return (metric.value, metric.std) if isinstance(metric, Measured) else (float(metric), np.nan)
