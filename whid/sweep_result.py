"""What a sweep found: numbers by metric, cell and repeat, as a table and against the bounds of `expect:`."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.config.study import Bound, Study
from whid.errors import FAILED
from whid.files.journal import Outcome, Place
from whid.quantity import Cell, Measured, Table
from whid.result import Check, at_frequency, judged
from whid.signal import Floats
from whid.tables import cell as as_text

QUANTILES = (0.05, 0.5, 0.95)
ERRORS = (".error.max", ".error.rms")  # metrics that are errors themselves: their RMSE is about 0


@dataclass(frozen=True, eq=False)
class SweepResult:
    """What a sweep found: cells × repeats.

    over    the values of every swept path, one a cell
    values  metric → (cells, repeats), NaN where it failed or is not measured; std likewise
    errors  (cells, repeats) why a repeat failed, "" where it did not
    truth   metric → (cells,) what is true of a simulated plant, of the metrics that estimate something of it
    bound   metric → (cells,) the Cramér-Rao bound of their standard deviation
    records (cells,) why its repeats had whole records, "" where their statistics were drawn
    """

    name: str
    over: Mapping[str, tuple[Any, ...]]
    values: Mapping[str, Floats]
    std: Mapping[str, Floats]
    errors: NDArray[Any]
    truth: Mapping[str, Floats] = field(default_factory=dict)
    bound: Mapping[str, Floats] = field(default_factory=dict)
    records: tuple[str, ...] = ()
    expect: tuple[Bound, ...] = ()
    pictures: tuple[str, ...] = ()
    path: Path | None = None
    reused: bool = False

    @property
    def failed(self) -> int:
        """Return how many repeats failed."""
        return int((self.errors != "").sum())

    @property
    def checks(self) -> tuple[Check, ...]:
        """Return every bound of `expect:` against the cell that comes nearest to breaking it."""
        return tuple(check for bound in self.expect for check in _checks(bound, self.values))

    @property
    def swept(self) -> tuple[str, ...]:
        """Return the swept paths whose values are numbers, more than one of them: the axis of a picture."""
        numeric = {path: all(isinstance(v, (int, float)) for v in values) for path, values in self.over.items()}
        return tuple(path for path, values in self.over.items() if numeric[path] and len(set(values)) > 1)

    @property
    def exit_code(self) -> int:
        """Return 0, or that of a repeat that failed (3), of a breached bound (4), of one that was not measured (5)."""
        return FAILED if self.failed else judged(self.checks)

    def failures(self) -> Table:
        """Return every reason, in which cell and how often."""
        rows: list[tuple[Cell, ...]] = []
        for c, place in enumerate(self._places()):
            reasons, counts = np.unique([e for e in self.errors[c] if e], return_counts=True)
            rows += [(*place, int(n), str(reason)) for reason, n in zip(reasons, counts, strict=True)]
        return Table("Failures", (*self.over, "n", "reason"), tuple(rows))

    def table(self, metrics: Sequence[str] = ()) -> Table:
        """Return one row a cell and metric: mean ± its error, sd, RMSE, quantiles, how many; by default what `expect:`
        names and every metric that is not of a single frequency.

        RMSE is about the truth of a simulated plant, of metrics that are errors about 0; empty where neither is known.
        """
        named = list(dict.fromkeys([*metrics, *(bound.metric for bound in self.expect)]))
        chosen = named or [name for name in self.values if not at_frequency(name)]
        nothing = [_NOTHING] * len(self.errors)
        summed = {
            name: _summary(self.values[name], self._target(name)).rows() if name in self.values else nothing
            for name in chosen
        }
        failed = (self.errors != "").sum(axis=1).tolist()
        rows = [(*place, name, *summed[name][c], failed[c]) for c, place in enumerate(self._places()) for name in chosen]
        quantiles = tuple(f"{q:.0%}" for q in QUANTILES)
        columns = (*self.over, "metric", "mean ± its error", "sd", "RMSE", *quantiles, "n", "failed")
        return Table(f"Sweep {self.name}", columns, tuple(rows), self._made())

    def _made(self) -> tuple[str, ...]:
        """Say how the cells' records were made, and why so."""
        ways = dict.fromkeys(self.records)
        if set(ways) == {""}:
            return ("records: drawn statistics; what only samples tell (estimation.rms, …) is not there",)
        return tuple(
            f"records: {f'full, because {why}' if why else 'drawn statistics'}"
            f"{f' ({self.records.count(why)} of {len(self.records)} cells)' if len(ways) > 1 else ''}"
            for why in ways
        )

    def _places(self) -> list[tuple[str, ...]]:
        return [tuple(as_text(value) for value in values) for values in zip(*self.over.values(), strict=True)]

    def _target(self, name: str) -> Floats:
        cells = len(self.errors)
        return self.truth.get(name, np.zeros(cells) if name.endswith(ERRORS) else np.full(cells, np.nan))


class _Summary(NamedTuple):
    """Statistics of one metric, one number a cell."""

    n: NDArray[np.intp]
    mean: Floats
    sd: Floats
    rmse: Floats
    quantiles: Floats  # (quantiles, cells)

    def rows(self) -> list[tuple[Cell, ...]]:
        """Return a row a cell."""
        error = self.sd / np.sqrt(np.maximum(self.n, 1))
        columns = [x.tolist() for x in (self.mean, error, self.sd, self.rmse, *self.quantiles, self.n)]
        return [
            (Measured(mean, of), sd, rmse if rmse == rmse else None, *rest)
            for mean, of, sd, rmse, *rest in zip(*columns, strict=True)
        ]


_NOTHING: tuple[Cell, ...] = (None, None, None, *(None for _ in QUANTILES), 0)


def _summary(values: Floats, target: Floats) -> _Summary:
    values = np.where(np.isfinite(values), values, np.nan)
    count = np.isfinite(values).sum(axis=1)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # a cell in which everything failed
        mean, sd = np.nanmean(values, axis=1), np.where(count > 1, np.nanstd(values, axis=1, ddof=1), np.nan)
        rmse = np.sqrt(np.nanmean((values - target[:, None]) ** 2, axis=1))
        return _Summary(count, mean, sd, rmse, _quantiles(values, count))


def _quantiles(values: Floats, count: NDArray[np.intp]) -> Floats:
    """Return the quantiles of each row, (quantiles, cells); rows with numbers missing take their time in numpy."""
    found = np.quantile(values, QUANTILES, axis=1)
    for c in np.flatnonzero((count < values.shape[1]) & (count > 0)):
        found[:, c] = np.nanquantile(values[c], QUANTILES)
    return np.asarray(found)


def gathered(study: Study, over: Mapping[str, tuple[Any, ...]], outcomes: Iterable[tuple[Place, Outcome]]) -> SweepResult:
    """Return outcomes as arrays; metrics in the order in which they first came."""
    assert study.sweep is not None
    shape = (len(next(iter(over.values()))), study.sweep.repeats)
    errors = np.full(shape, "", object)
    values: dict[str, Floats] = {}
    std: dict[str, Floats] = {}
    records = [""] * shape[0]
    for place, outcome in outcomes:
        records[place[0]] = outcome.records
        errors[place] = outcome.error
        for name, (value, error) in outcome.metrics.items():
            if name not in values:
                values[name], std[name] = np.full(shape, np.nan), np.full(shape, np.nan)
            values[name][place], std[name][place] = value, error
    return SweepResult(study.name, over, values, std, errors, records=tuple(records), expect=study.expect)


def _checks(bound: Bound, values: Mapping[str, Floats]) -> Iterator[Check]:
    """Yield a bound against the cell that comes nearest to breaking it; a cell without a number breaks it."""
    if bound.metric not in values:
        yield from bound.checks(np.empty(0))
        return
    cells = [row[np.isfinite(row)] for row in values[bound.metric]]
    sides = zip(*(bound.checks(row if len(row) else np.array([np.nan])) for row in cells), strict=True)
    for found in sides:
        worst = next((check for check in found if check.verdict != "pass"), None)
        yield worst or min(found, key=lambda check: check.margin)
