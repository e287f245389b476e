"""Study: what one YAML file declares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, MinLen

from whid.errors import WhidError
from whid.experiments._experiment import Experiment
from whid.files.source import DataSource
from whid.methods._method import Method
from whid.papers._exhibit import Exhibit, Published
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
    """One line of `expect:`, such as {metric: report.rms, below: 0.31}; a missing or NaN metric never passes."""

    metric: Annotated[str, MinLen(1)]
    below: float | None = None
    above: float | None = None

    def __post_init__(self) -> None:
        if self.below is None and self.above is None:
            raise WhidError("config-value", "a bound needs `below:`, `above:` or both")
        if self.below is not None and self.above is not None and self.above >= self.below:
            raise WhidError("config-value", f"nothing is above {self.above:g} and below {self.below:g}")


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """`over:` maps paths, written as for `--set`, to lists of values; every cell runs `repeats` times.

    grid: all combinations; zip: the first values together, then the second, … (lists of one length).
    """

    over: Annotated[dict[str, Annotated[list[Any], MinLen(1)]], MinLen(1)]
    repeats: Annotated[int, Ge(1)] = 1
    mode: Literal["grid", "zip"] = "grid"

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
