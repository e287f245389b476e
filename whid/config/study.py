"""Study: what one YAML file declares."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Lt, MinLen

from whid.blocks.linear import Linear
from whid.errors import WhidError
from whid.experiments._experiment import Experiment
from whid.files.source import DataSource
from whid.methods._method import Method
from whid.papers._exhibit import Exhibit, Published
from whid.result import Check
from whid.signal import Floats
from whid.system import System
from whid.trace import Trace


@dataclass(frozen=True)
class Match:
    """Marks a text field: what it must match, and how to say so."""

    pattern: str
    words: str


# a folder is named after the study: no separators, no leading dot
NAME = Match(r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$", "1 to 64 letters, digits, `-`, `_`, `.`, no `.` in front")


@dataclass(frozen=True, kw_only=True)
class Bound:
    """One line of `expect:`, such as {metric: report.rms, below: 0.31}; a missing or NaN metric never passes.

    Of a run the metric's value is judged, of a sweep the mean of every cell. confidence 0.95: the upper (against `below`) or
    lower (against `above`) 95 % limit of that mean, of a run that of the value with its standard error. quantile 0.9: nine
    repeats in ten; of a run, of the normal distribution that value and standard error make.
    """

    metric: Annotated[str, MinLen(1)]
    below: float | None = None
    above: float | None = None
    confidence: Annotated[float, Gt(0.5), Lt(1)] | None = None
    quantile: Annotated[float, Gt(0), Lt(1)] | None = None

    def __post_init__(self) -> None:
        if self.below is None and self.above is None:
            raise WhidError("config-value", "a bound needs `below:`, `above:` or both")
        if self.below is not None and self.above is not None and self.above >= self.below:
            raise WhidError("config-value", f"nothing is above {self.above:g} and below {self.below:g}")
        if self.confidence is not None and self.quantile is not None:
            raise WhidError("config-value", "a bound is on the mean's `confidence:` limit or on a `quantile:`, not both")

    def checks(self, values: Floats, std: float = float("nan")) -> Iterator[Check]:
        """Yield the bound held against repeats (n,), or against one value and its standard error.

        >>> [check.value for check in Bound(metric="m", below=9, quantile=0.5).checks(np.array([1.0, 2.0, 6.0]))]
        [2.0]
        >>> [round(check.value, 2) for check in Bound(metric="m", below=9, confidence=0.95).checks(np.array([1.0]), 0.1)]
        [1.16]
        """
        if self.confidence is None or self.below is None or self.above is None:
            yield Check(self.metric, self._statistic(values, std, self.below is None), self.below, self.above, self.of)
        else:
            yield Check(self.metric, self._statistic(values, std, False), self.below, None, self.of)
            yield Check(self.metric, self._statistic(values, std, True), None, self.above, self.of)

    @property
    def of(self) -> str:
        """Say what of the metric is judged, "" for its value."""
        if self.quantile is not None:
            return f"{self.quantile:.6g} quantile"
        return "" if self.confidence is None else f"{100 * self.confidence:.6g} % limit"

    def _statistic(self, values: Floats, std: float, lower: bool) -> float | None:
        from scipy.special import ndtri, stdtrit

        n = len(values)
        if n == 0:
            return None
        mean = float(values.mean())
        if self.quantile is not None:
            return float(np.quantile(values, self.quantile)) if n > 1 else mean + float(ndtri(self.quantile)) * std
        if self.confidence is None:
            return mean
        error, times = (float(values.std(ddof=1)) / n**0.5, stdtrit(n - 1, self.confidence)) if n > 1 else (
            std, ndtri(self.confidence))  # fmt: skip
        return mean - float(times) * error if lower else mean + float(times) * error


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """`over:` maps paths, written as for `--set`, to lists of values; every cell runs `repeats` times.

    grid: all combinations; zip: the first values together, then the second, … (lists of one length).
    full_records: simulate every record, even where drawing levels and harmonics as it would give them is the same.
    """

    over: Annotated[dict[str, Annotated[list[Any], MinLen(1)]], MinLen(1)]
    repeats: Annotated[int, Ge(1)] = 1
    mode: Literal["grid", "zip"] = "grid"
    full_records: bool = False

    def __post_init__(self) -> None:
        lengths = {path: len(values) for path, values in self.over.items()}
        if self.mode == "zip" and len(set(lengths.values())) > 1:
            raise WhidError("config-value", f"`mode: zip` needs lists of one length, not {lengths}", "over")


@dataclass(frozen=True, kw_only=True)
class Study:
    """A plant and an experiment to simulate, or data; a method; what is expected of the result.

    name       the run folder's name begins with it
    seed       of everything random
    plant      with experiment (one, or a list: one record each): simulated
    data       one measured record; records: several
    model      what we believe: its structure counts, its numbers are start values
    identify   the method
    expect     bounds on metrics; a breach ends the run with exit code 4
    trace      which effects compete when the run is to say what the model lacks; left out: the loop is not closed
    sweep      what `whid sweep` varies
    table      tables and figures of a paper that `whid table` makes anew; what they say was printed stands beside ours
    compare_with_paper  print a paper's own estimates beside the efficient ones, with their standard errors
    """

    name: Annotated[str, NAME]
    seed: Annotated[int, Ge(0)] = 0
    plant: System | None = None
    experiment: tuple[Experiment, ...] = ()
    data: DataSource | None = None
    records: tuple[DataSource, ...] = ()
    model: System | None = None
    identify: Method
    trace: Trace | None = None
    expect: tuple[Bound, ...] = ()
    sweep: Sweep | None = None
    table: tuple[Exhibit, ...] = ()
    compare_with_paper: bool = False

    def __post_init__(self) -> None:
        given = [key for key in ("plant", "data", "records") if getattr(self, key)]
        if len(given) != 1:
            what = " and ".join(given) or "nothing"
            raise WhidError("config-source", f"needs exactly one of plant (with experiment), data, records, not {what}")
        if (self.plant is None) != (not self.experiment):
            missing = "experiment" if self.plant else "plant"
            raise WhidError("config-source", "plant and experiment go together", missing)
        for k, block in enumerate(self.plant.chain if self.plant else ()):
            if isinstance(block, Linear) and (pole := block.growing()) is not None:
                message = (
                    f"unstable: the pole {pole:.4g} makes the output grow without bound; inside `feedback` it may stand"
                )
                raise WhidError("block-parameters", message, f"plant.chain.{k}")
        names = [record.name for record in self.experiment] + [source.name for source in self.sources]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise WhidError("config-value", f"two records are named {twice!r}: give each a `name:` of its own")

    @property
    def published(self) -> tuple[Published, ...] | None:
        """Return what papers printed, () where only their methods are to be compared with, None where nothing is."""
        printed = tuple(row for exhibit in self.table for row in exhibit.published)
        return printed or (() if self.compare_with_paper else None)

    @property
    def sources(self) -> tuple[DataSource, ...]:
        """Return the measured records."""
        return self.records if self.data is None else (self.data,)
