"""Result: everything a run found, in memory; `files/result.py` writes it and reads it back under the same names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

from whid.errors import CATALOGUE, Explanation, WhidError
from whid.quantity import Measured, Table
from whid.record import Record
from whid.signal import Floats
from whid.system import System

BREACHED, NOT_MEASURED = 4, 5


class Check(NamedTuple):
    """One `expect:` bound held against the metric it names; `value` is None where there is no such metric.

    of  what of the metric the value is: "" itself (of a sweep the mean of a cell), else a confidence limit or a quantile
    """

    metric: str
    value: float | None
    below: float | None = None
    above: float | None = None
    of: str = ""

    @property
    def verdict(self) -> Literal["pass", "breached", "not measured"]:
        """Return how the bound came out; NaN is never a pass.

        >>> [Check("front.gain.error.max", v, below=0.003).verdict for v in (0.001, float("nan"), None)]
        ['pass', 'breached', 'not measured']
        """
        if self.value is None:
            return "not measured"
        low = self.above is None or self.value > self.above
        high = self.below is None or self.value < self.below
        return "pass" if self.value == self.value and low and high else "breached"

    @property
    def margin(self) -> float:
        """Return how far the value is inside its bounds."""
        value = float("nan") if self.value is None else self.value
        below, above = (float("inf") if x is None else x for x in (self.below, self.above))
        return min(below - value, value - above if self.above is not None else float("inf"))


def judged(checks: Iterable[Check]) -> int:
    """Return the exit code of bounds: 0, 4 where one is breached, else 5 where one was not measured.

    >>> judged([Check("a", 1.0, below=2.0), Check("b", None, below=2.0)])
    5
    """
    verdicts = {check.verdict for check in checks}
    return BREACHED if "breached" in verdicts else NOT_MEASURED if "not measured" in verdicts else 0


class Asked(NamedTuple):
    """An experiment that a method asked for (`Wanted`): its parts as YAML holds them, and what became of it.

    record: the name of the Record that answered it, "" where it was `refused`, with the reason; answer: what it told.
    """

    reason: str
    predicted_se: float
    of: str
    plan: tuple[dict[str, Any], ...]
    samples: int
    record: str = ""
    refused: str = ""
    answer: str = ""


class Failure(NamedTuple):
    """Why a run is incomplete: the code and message of the fault, and what was being done."""

    code: str
    message: str
    during: str

    @property
    def explanation(self) -> Explanation:
        """Return what the catalogue says; of a code that it has no more, what it says of any failure."""
        return CATALOGUE.get(self.code, CATALOGUE["method-failed"])


@dataclass(frozen=True, eq=False)
class Result:
    """What a run found.

    records    what was simulated or ingested, then what methods asked for
    stages     every stage's NamedTuple by its snake_case class name, in order; the model is the last
    residuals  y − ŷ of every record (NaN where there is no y), empty without a model
    metrics    numbers by name, `Measured` where they have a standard error
    published  (quantity, printed value, printed truth) of the literature; () compares with a paper's method only, None not
    provenance config text, versions, seed, hashes, notes
    """

    name: str
    records: tuple[Record, ...]
    stages: Mapping[str, Any]
    truth: System | None = None
    residuals: tuple[Floats, ...] = ()
    metrics: Mapping[str, float | Measured] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    asked: tuple[Asked, ...] = ()
    warnings: tuple[str, ...] = ()
    error: Failure | None = None
    published: tuple[tuple[str, float | None, float | None], ...] | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    pictures: tuple[str, ...] = ()
    path: Path | None = None
    reused: bool = False

    def __repr__(self) -> str:
        """Return one line: a record has too many numbers for a prompt."""
        told = [f"{name} {self.metrics[name]:.6g}" for name in ("estimation.rms", "report.rms") if name in self.metrics]
        state = f"incomplete: {self.error.message}" if self.error else ", ".join(told) or "no model"
        return f"<Result {self.name}: {len(self.records)} records, {len(self.stages)} stages, {state}, {self.path}>"

    @property
    def model(self) -> Any:
        """Return the identified Model; raise the `WhidError` that stopped the run if there is none."""
        if "model" not in self.stages:
            fault = self.error or Failure("method-failed", "the method yielded no model", "identification")
            raise WhidError(fault.code, fault.message, fault.during)
        return self.stages["model"]

    def every(self, stage: str) -> Iterator[Any]:
        """Yield all results of one stage: `harmonics`, `harmonics_2`, … of one sine after another."""
        return (value for name, value in self.stages.items() if re.fullmatch(rf"{stage}(_\d+)?", name))

    @property
    def exit_code(self) -> int:
        """Return 0, or the exit code of the fault, of a breached bound (4), of one that was not measured (5)."""
        if self.error:
            return self.error.explanation.exit_code
        return judged(self.checks)


def at_frequency(metric: str) -> bool:
    """Tell whether a metric is one of a single frequency, of which there are many.

    >>> at_frequency("joint.back.gain@0.02"), at_frequency("verdict.friction@parallel.coefficient")
    (True, False)
    """
    return re.search(r"@[\d.]+(e[+-]?\d+)?$", metric) is not None


def snake_case(name: str) -> str:
    """Return a class name as a stage's name.

    >>> snake_case("PeriodAverage")
    'period_average'
    """
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()
