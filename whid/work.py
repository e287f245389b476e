"""A run under way: records obtained, a method's stages collected, the experiments it wants served, all of it scored."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from whid import drawn, score
from whid.config.study import Study
from whid.errors import WhidError
from whid.experiments._experiment import Experiment
from whid.files.ingest import ingest
from whid.files.ingest_long import ingest_long
from whid.kinds import plain
from whid.long_record import LongRecord
from whid.methods._method import Answered, Explained, Model, Wanted
from whid.quantity import Measured
from whid.record import Record
from whid.residual import Misfit, misfit, misfit_of, thinned
from whid.result import Asked, Failure, Result, snake_case
from whid.signal import Floats
from whid.simulate import Clean, simulate, stream
from whid.stages.intersample import intersample
from whid.tables import in_units
from whid.trace import trace as closed_loop

HEAD = 200_000  # samples of a long record that are looked at for doubts
DECIDES = "it decides between effects: measure it, add the record, trace again"
Watch = Callable[[str, float], None]  # a finished step and its seconds


@dataclass
class Clock:
    """Tells the log, and whoever watches, what was finished and how long it took."""

    log: Callable[[str], None]
    watch: Watch | None
    since: float = field(default_factory=time.perf_counter)

    def tick(self, step: str) -> None:
        """Tell that a step is finished."""
        now = time.perf_counter()
        seconds, self.since = now - self.since, now
        self.log(f"{step} ({seconds:.3f} s)")
        if self.watch:
            self.watch(step, seconds)


@dataclass
class Work:
    """A run under way: what is finished so far."""

    study: Study
    base: Path
    seeds: np.random.SeedSequence
    clock: Clock
    records: list[Record | LongRecord] = field(default_factory=list)
    misfits: tuple[Misfit, ...] = ()
    notes: list[str] = field(default_factory=list)
    stages: dict[str, Any] = field(default_factory=dict)
    asked: list[Asked] = field(default_factory=list)
    metrics: dict[str, float | Measured] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    error: Failure | None = None
    doing: str = ""
    clean: Clean | None = None
    chunked: bool = False
    statistics: drawn.Drawn | None = None  # drawn ones, in place of what samples would give
    alone: bool = True  # somebody reads the warnings

    def attempt(self, *steps: Callable[[], None]) -> None:
        """Do the steps; a fault ends the work, not what was finished."""
        try:
            for step in steps:
                self.doing = step.__name__
                step()
        except WhidError as fault:
            self.error = Failure(fault.code, str(fault), self.doing)
        except KeyboardInterrupt:
            self.error = Failure("interrupted", "interrupted; what was finished is kept", self.doing)
        except Exception as fault:
            self.clock.log(traceback.format_exc())
            self.error = Failure("method-failed", f"{type(fault).__name__}: {fault}", self.doing)

    def obtain(self) -> None:
        """Simulate the experiments or ingest the files."""
        for experiment in self.study.experiment:
            self.perform(experiment, self.chunked)
        for source in self.study.sources:
            found = ingest_long(source, self.base) if self.chunked else ingest(source, self.base)
            self.records.append(found.record)
            self.notes += [f"{found.record.name}: {note}" for note in found.notes]
            self.clock.tick(f"ingested {found.record.name}, {len(found.record)} samples")

    def perform(self, experiment: Experiment, chunked: bool = False) -> Record | LongRecord:
        """Simulate one experiment with a generator of its own."""
        assert self.study.plant is not None
        rng = np.random.default_rng(self.seeds.spawn(1)[0])
        if chunked:
            self.records.append(stream(self.study.plant, experiment, rng))
            self.clock.tick(f"to simulate in chunks: {experiment.name}, {len(self.records[-1])} samples")
        else:
            self.records.append(simulate(self.study.plant, experiment, rng, clean=self.clean))
            self.clock.tick(f"simulated {experiment.name}, {len(self.records[-1])} samples")
        return self.records[-1]

    def identify(self) -> None:
        """Run the method on what it may see, collect its stages, serve the experiments it wants."""
        method, model = self.study.identify, self.study.model
        records = cast(list[Record], [_open(record) for record in self.records])  # long ones only where it takes them
        stages = method.staged(self.statistics, model) if self.statistics else method(records, model)
        answer: Record | None = None
        try:
            while True:
                found, answer = stages.send(answer), None
                if isinstance(found, Wanted):
                    answer = self.serve(found)
                elif isinstance(found, Answered):
                    self.asked[-1] = self.asked[-1]._replace(answer=found.text)
                elif isinstance(found, Explained):
                    self.misfits = found.misfits
                else:
                    self.collect(found)
        except StopIteration:
            if "model" not in self.stages:
                raise WhidError("method-failed", "the method yielded no model") from None

    def serve(self, wanted: Wanted) -> Record | None:
        """Perform an experiment on a simulated plant within its budget; log it, and why it was not."""
        name = f"wanted_{len(self.asked) + 1}"
        like = next(iter(self.study.experiment), None)
        experiment = Experiment(dt=self.records[0].dt, parts=wanted.plan, name=name)
        experiment = replace(like, parts=wanted.plan, name=name) if like else experiment
        plan, samples = tuple(plain(part) for part in wanted.plan), experiment.samples()
        asked = Asked(wanted.reason, float(wanted.predicted_se), in_units(wanted.of, self.records[0].units), plan, samples)
        refused = self.refusal(experiment)
        self.asked.append(asked._replace(refused=refused) if refused else asked._replace(record=name))
        return None if refused else cast(Record, _open(self.perform(experiment)))

    def refusal(self, experiment: Experiment) -> str:
        """Return why an experiment asked for is not performed, "" if it is: measured data, no budget, beyond the budget."""
        if not self.study.experiment:
            return "the data are measured: `whid next` writes the plan"
        if experiment.adaptive is None:
            return "no `adaptive:` in the experiment"
        done = [asked for asked in self.asked if asked.record]
        limits = experiment.adaptive
        for what, limit, used, more in (
            ("experiments", limits.max_experiments, sum(len(asked.plan) for asked in done), len(experiment.plan())),
            ("samples", limits.max_samples, sum(asked.samples for asked in done), experiment.samples()),
        ):
            if used + more > limit:
                return f"beyond the budget: {more} {what} more, {used} of {limit} used"
        return ""

    def collect(self, stage: Any) -> None:
        """Keep a stage's result under its class' name, numbered from the second of a class on."""
        base = name = snake_case(type(stage).__name__)
        number = 2
        while name in self.stages:
            name, number = f"{base}_{number}", number + 1
        self.stages[name] = stage
        self.doing = f"identify, after {name}"
        self.clock.tick(name)

    def trace(self) -> None:
        """Close the loop where the study says so: from the declared model, or from the one that was identified."""
        if self.study.trace is None:
            return
        system = self.study.model or self.stages["model"].system
        for found in closed_loop(system, cast(list[Record], self.records), self.study.trace, path_of(self.study)):
            if isinstance(found, Wanted):
                self.note(found)
                continue
            if isinstance(found, Model):
                self.misfits = ()  # they were the other model's
                self.stages["model_before"] = self.stages.pop("model")
            self.collect(found)

    def note(self, wanted: Wanted) -> None:
        """Keep the experiment that would decide between effects: it is for whoever asked, not performed."""
        plan = Experiment(dt=self.records[0].dt, parts=wanted.plan)
        parts = tuple(plain(part) for part in wanted.plan)
        asked = Asked(wanted.reason, float(wanted.predicted_se), wanted.of, parts, plan.samples(), refused=DECIDES)
        self.asked.append(asked)

    def assess(self) -> None:
        """Open the report parts: the residual of every record, then the score."""
        model = self.stages["model"]
        path = path_of(self.study)
        if self.statistics:
            self.misfits = tuple(misfit_of(record, record.y) for record in self.statistics.records)  # of no output: none
        elif not self.misfits:  # the method has not seen all that there is to see
            self.misfits = tuple(misfit(model.system.tree, record, path) for record in self.records)
        self.metrics = dict(score.score(model, self.records, self.misfits, self.study.plant))
        for stage in self.stages.values():
            self.metrics |= stage.metrics() if hasattr(stage, "metrics") else {}
            self.warnings += stage.doubts() if hasattr(stage, "doubts") else ()
        self.warnings += score.doubts(model, self.metrics)
        self.clock.tick("score")
        self.warnings += input_doubts([_open(record) for record in self.records]) if self.alone else ()

    def kept(self) -> tuple[Record, ...]:
        """Return the records, of long ones every so many-th sample."""
        if self.misfits:
            return tuple(found.record for found in self.misfits)
        return tuple(thinned(record) if isinstance(record, LongRecord) else record for record in self.records)

    def result(self, origin: Mapping[str, Any]) -> Result:
        """Return what there is, its bounds checked."""
        printed = self.study.published
        paths = dict.fromkeys(experiment.path for experiment in self.study.experiment)
        facts = {"seed": self.study.seed, "path": " and ".join(paths) or "measured", "method": self.study.identify.kind}
        return Result(
            name=self.study.name, records=self.kept(), stages=self.stages, truth=self.study.plant,
            residuals=tuple(found.error for found in self.misfits), metrics=self.metrics, asked=tuple(self.asked),
            error=self.error,
            published=None if printed is None else tuple((row.quantity, row.value, row.truth) for row in printed),
            checks=tuple(c for bound in self.study.expect for c in bound.checks(*_numbers(self.metrics, bound.metric))),
            warnings=tuple(self.warnings), provenance={**origin, **facts, "notes": tuple(self.notes)},
        )  # fmt: skip


def path_of(study: Study) -> Literal["exact", "sampled"]:
    """Return how the records are simulated."""
    return "sampled" if any(experiment.path == "sampled" for experiment in study.experiment) else "exact"


def _open(record: Record | LongRecord) -> Record | LongRecord:
    """Return what a method may see of a record: no output of a report part."""
    return record.without("report") if record.has("report") else record


def input_doubts(records: Sequence[Record | LongRecord]) -> Iterator[str]:
    """Yield a warning for every record whose input seems to do something else between samples than is declared."""
    for record in records:
        if isinstance(record, LongRecord):
            record = replace(record.head(HEAD), parts=record.parts)
        if record.parts and all(part.kind == "sine" for part in record.parts):
            continue  # the next sample of a sine is known from the last two: nothing to tell by
        known = np.flatnonzero(np.diff(np.isfinite(record.y), prepend=False, append=False)).reshape(-1, 2)
        if len(known):
            longest = slice(*known[np.argmax(np.diff(known, axis=1))])
            found = intersample(record.u[longest], record.y[longest], record.intersample)
            if found.verdict == "does not fit":
                misfit = f"record {record.name}: `intersample: {found.declared}` does not fit (p = {found.p:.1g})"
                yield f"{misfit}: {found.reason}; try `intersample: {found.alternative}`"


def _numbers(metrics: Mapping[str, float | Measured], name: str) -> tuple[Floats, float]:
    """Return the value of a metric, none where there is none, and its standard error."""
    found = metrics.get(name)
    value, std = found if isinstance(found, Measured) else (found, float("nan"))
    return np.array([] if value is None else [value]), std
