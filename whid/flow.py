"""The flow: a study's records, its method's stages, their score, and the folder that keeps them.

    obtain records ─► identify (stage by stage, wanted experiments served) ─► trace ─► assess ─► check bounds ─► keep

Every step is a call. A run that fails once it has its records keeps what was finished, with the reason.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whid import drawn, plots, score, summary
from whid.config.load import Overrides, as_system, load_study, resolved
from whid.config.memory import allow
from whid.config.next_plan import next_plan
from whid.config.refined import refined_study
from whid.config.study import Study
from whid.errors import WhidError
from whid.files import run_folder
from whid.files.provenance import provenance
from whid.files.result import read_result, write_result
from whid.files.run_folder import RunFolder
from whid.files.source import locate
from whid.methods.fit import Fit
from whid.quantity import Table
from whid.result import Result
from whid.simulate import Clean
from whid.trace import Trace
from whid.work import DECIDES, Clock, Watch, Work, path_of


def run(
    config: str | Path | Mapping[str, Any] | Study,
    out: str | Path = "runs",
    overrides: Overrides = (),
    *,
    base: Path | None = None,
    force: bool = False,
    max_memory: float = 4e9,
    watch: Watch | None = None,
) -> Result:
    """Run a study and return its result, kept in `<out>/<name>-<hash10>/`.

    The same study on the same data is not run again: its finished result is returned, `reused`; `force` runs it into a
    sibling folder. A method that fails does not raise: the result has its `error` and every stage before it.
    `base` is the folder that data files are relative to, left out: the config's own. `watch(step, seconds)` is called after
    every step. Raises `WhidError` for a faulty config, faulty data, a plant that cannot be simulated, a study beyond
    `max_memory` (bytes), a folder that cannot be written.
    """
    study = config if isinstance(config, Study) else load_study(config, overrides)
    base = base or (Path(config).parent if isinstance(config, (str, Path)) else Path())
    chunked = allow(study, max_memory, base)
    origin = provenance(resolved(study), [locate(source.file, base) for source in study.sources])
    stem = run_folder.stem(study.name, origin["hash"])
    if not force and (done := run_folder.finished(Path(out), stem)):
        return replace(load(done), reused=True)
    with RunFolder(Path(out), stem) as folder:
        work = Work(study, base, np.random.SeedSequence(study.seed), Clock(folder.log, watch), chunked=chunked)
        work.obtain()
        work.attempt(work.identify, work.trace, work.assess)
        result = work.result(origin)
        refined = (
            refined_study(study, result.stages, base) if "verdict" in result.stages and "model" in result.stages else ""
        )
        return _kept(result, folder, work.clock, refined)


def execute(study: Study, base: Path, seeds: np.random.SeedSequence, clean: Clean | None = None) -> Result:
    """Run a study in memory: no folder, no pictures, no tables (a sweep runs thousands, sharing what is free of noise)."""
    work = Work(study, base, seeds, Clock(lambda line: None, None), clean=clean, alone=False)
    work.attempt(work.obtain, work.identify, work.trace, work.assess)
    return work.result({})


def execute_drawn(study: Study, seeds: np.random.SeedSequence) -> Result:
    """Run a study that `records_needed` does not refuse on drawn statistics; what only samples tell is not there."""
    assert study.plant is not None
    plans = drawn.plans(study.plant, study.experiment)
    std = [plan.std(study.plant.noise) for plan in plans]
    work = Work(study, Path(), seeds, Clock(lambda line: None, None), alone=False)
    work.statistics = drawn.Drawn(plans, std, seeds.spawn(len(plans)))
    work.records = list(work.statistics.records)
    work.attempt(work.identify, work.assess)
    return work.result({})


def records_needed(study: Study) -> str:
    """Return why a study's repeats need whole records, "" where drawn statistics are the same to it."""
    if study.plant is None:
        return "the data are measured"
    if study.trace is not None:
        return "the closed loop looks at samples"
    samples = sum(experiment.samples() for experiment in study.experiment)
    if wants := study.identify.wants_samples(samples):
        return wants
    if named := next((bound.metric for bound in study.expect if bound.metric.startswith(score.OF_SAMPLES)), ""):
        return f"`expect:` bounds {named}, which only samples tell"
    return drawn.refusal(study.plant, study.experiment, *study.identify.reads())


def trace(
    config: str | Path | Mapping[str, Any] | Study,
    out: str | Path = "runs",
    overrides: Overrides = (),
    *,
    base: Path | None = None,
    force: bool = False,
    max_memory: float = 4e9,
    watch: Watch | None = None,
) -> Result:
    """Run a study and close the loop: say what its model lacks, add it, and report the error before and after.

    With `model:` that tree is what is fitted and traced, `identify:` is not run; without, the method's model is. Everything
    else as in `run`, whose arguments these are. The verdict is `result.stages["verdict"]` (`whid.trace.Verdict`),
    `whid.trace.as_object(verdict)` the object that `whid trace --json` prints; `result.stages["model"]` the refined model,
    and `refined.yaml` in the folder a study that runs as it is.
    """
    study = config if isinstance(config, Study) else load_study(config, overrides)
    base = base or (Path(config).parent if isinstance(config, (str, Path)) else Path())
    return run(to_trace(study), out, base=base, force=force, max_memory=max_memory, watch=watch)


def to_trace(study: Study) -> Study:
    """Return the study that `trace` runs: `execute(to_trace(study), base, seeds)` closes the loop in memory."""
    method = study.identify if study.model is None else Fit(path=path_of(study))
    return replace(study, trace=study.trace or Trace(), identify=method)


def load(path: str | Path) -> Result:
    """Return the result in a run folder (or of a result.h5); raise `WhidError("run-not-found")` if there is none."""
    file = Path(path)
    file = file / "result.h5" if file.is_dir() else file
    if not file.is_file():
        raise WhidError("run-not-found", "no result.h5 here", str(path))
    return read_result(file, as_system)


def _kept(result: Result, folder: RunFolder, clock: Clock, refined: str = "") -> Result:
    """Draw, tabulate and write a result, and the refined study's text; a picture that fails is a warning."""
    pictures, faults = plots.draw(result, folder.path)
    clock.tick("pictures")
    result = replace(result, pictures=pictures, warnings=(*result.warnings, *faults))
    result = replace(result, tables=_tables(result))
    write_result(folder.path / "result.h5", result, score.units)
    folder.write("config.yaml", result.provenance["config"])
    folder.write("summary.md", summary.page(result))
    if refined:
        folder.write("refined.yaml", refined)
    if decides := tuple(asked for asked in result.asked if asked.refused == DECIDES):
        folder.write("deciding.yaml", next_plan(replace(result, asked=decides)))
    clock.tick("written")
    if result.error:
        folder.write("error.json", json.dumps(result.error._asdict(), indent=2))
        clock.log(f"error[{result.error.code}] in {result.error.during}: {result.error.message}")
    return replace(result, path=folder.keep("" if result.error else result.provenance["hash"]))


def _tables(result: Result) -> tuple[Table, ...]:
    """Return the summary; what a stage's own table dies of must not cost the numbers."""
    try:
        return summary.tables(result)
    except Exception as fault:
        return (Table("Summary", (), (), (f"not made: {type(fault).__name__}: {fault}",)),)
