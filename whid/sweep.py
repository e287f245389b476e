"""A study over a grid of values, many times: every cell and repeat is one identification with a seed of its own."""

from __future__ import annotations

import gc
import hashlib
import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whid import engine, flow, plots
from whid.config.load import load_study, load_variants, resolved
from whid.config.study import Study, Sweep
from whid.engine import Engine, Group
from whid.errors import WhidError
from whid.files import run_folder
from whid.files.journal import UNFINISHED, Journal, Outcome, Place
from whid.files.provenance import provenance
from whid.files.run_folder import RunFolder
from whid.files.source import locate
from whid.files.sweep_file import KEPT, read_sweep, write_sweep
from whid.quantity import Measured
from whid.result import Result, at_frequency
from whid.score import true_values, units
from whid.simulate import Clean
from whid.sweep_bound import Told, bounds, told
from whid.sweep_result import SweepResult, gathered
from whid.tables import as_csv, markdown

OBJECTS = 200_000  # newly made between two looks: those of some ten repeats
Watch = Callable[[int, int, str], None]  # finished, of how many, the reason of a failure just met ("" otherwise)


def sweep(
    config: str | Path | Mapping[str, Any],
    out: str | Path = "runs",
    overrides: Sequence[str] = (),
    *,
    jobs: int = 1,
    executor: Executor | None = None,
    scheduler: str = "",
    force: bool = False,
    fail_fast: bool = False,
    watch: Watch | None = None,
) -> SweepResult:
    """Run the study of a config over its `sweep:` and keep the outcome in `<out>/<name>-sweep-<hash10>/`.

    jobs > 1 uses that many processes, scheduler a Dask cluster, executor any other `concurrent.futures` engine; the numbers
    are the same, bit for bit: every repeat's seed is a `SeedSequence` keyed by the study's seed, the cell's values and the
    repeat. What is finished is in a journal at once; a sweep that was interrupted or killed goes on where it stopped. One
    that is done is not run again, unless `force`. A repeat that fails is an outcome with its reason; `fail_fast` ends at
    the first.
    Raises `WhidError` for a faulty config or one without `sweep:`, "sweep-failed" with fail_fast, "sweep-running" where
    another process is at it, "sweep-engine" where the cluster does not answer.
    """
    study = load_study(config, overrides)
    if study.sweep is None:
        raise WhidError("sweep-missing", "this study has no `sweep:` section")
    cells = [dict(zip(study.sweep.over, values, strict=True)) for values in combinations(study.sweep)]
    studies = list(load_variants(config, overrides, [_settings(chosen) for chosen in cells]))  # all faults come first
    base = Path(config).parent if isinstance(config, (str, Path)) else Path()
    origin = provenance(resolved(study), [locate(source.file, base) for source in study.sources])
    stem = run_folder.stem(f"{study.name}-sweep", origin["hash"])
    if not force and (done := run_folder.finished(Path(out), stem)):
        return replace(load(done), reused=True)
    tasks = len(cells) * study.sweep.repeats
    unfinished = Path(out) / f"{stem}{UNFINISHED}"
    with Journal(unfinished, origin["hash"], origin["config"], tasks) as journal, ThreadPoolExecutor(1) as aside:
        shared = [(each, base, study.sweep.full_records) for each in studies]
        groups = _groups(shared, cells, study.sweep.repeats, journal.places())
        run, known = _engine(jobs, executor, scheduler), None
        for each in _performed(run, groups, journal, tasks, watch, fail_fast):
            if known is None and any(map(at_frequency, each.metrics)):
                known = aside.submit(told, studies)  # while the workers work
        over = {path: tuple(chosen[path] for chosen in cells) for path in study.sweep.over}
        found = _judged(gathered(study, over, journal.outcomes()), studies, known)
        with RunFolder(Path(out), stem) as folder:
            found = _write(found, folder, origin)
            found = replace(found, path=folder.keep(origin["hash"]))
        journal.discard()
    return found


def _judged(found: SweepResult, studies: Sequence[Study], known: Future[Told] | None) -> SweepResult:
    """Return the sweep with what is true of the metrics, and the least standard error that each plan allows."""
    names = [name for name in found.values if at_frequency(name)]
    if studies[0].plant is None or not names:
        return found
    plants = {s.plant.chain: s.plant for s in studies if s.plant}  # a noise sweep has one
    truths = {chain: np.array(true_values(plant, names)) for chain, plant in plants.items()}
    columns = np.array([truths[s.plant.chain] for s in studies if s.plant]).T
    true = {name: column for name, column in zip(names, columns, strict=True) if np.isfinite(column).all()}
    return replace(found, truth=true, bound=bounds(known.result() if known else told(studies), studies, tuple(true)))


def load(path: str | Path) -> SweepResult:
    """Return the outcome kept in a sweep's folder."""
    folder = Path(path)
    study = load_study(folder / "config.yaml")
    kept = read_sweep(folder / "sweep.h5")
    pictures = tuple(sorted(path.name for path in folder.glob("*.png")))
    return SweepResult(study.name, **kept, expect=study.expect, pictures=pictures, path=folder)


def combinations(declared: Sweep) -> Iterator[tuple[Any, ...]]:
    """Yield the values of every cell.

    >>> list(combinations(Sweep(over={"plant.noise.std": [1, 2], "seed": [3, 4]})))
    [(1, 3), (1, 4), (2, 3), (2, 4)]
    """
    lists = declared.over.values()
    return iter(zip(*lists, strict=True)) if declared.mode == "zip" else itertools.product(*lists)


def key(chosen: Mapping[str, Any], repeat: int) -> tuple[int, ...]:
    """Return the spawn key of a repeat: from the cell's values, not its place, so that a grid may grow.

    >>> key({"plant.noise.std": 0.5}, 3) == key({"plant.noise.std": 0.5}, 3) != key({"plant.noise.std": 0.6}, 3)
    True
    """
    digest = hashlib.sha256(json.dumps(chosen, sort_keys=True).encode()).digest()
    return (*np.frombuffer(digest[:16], np.uint32).tolist(), repeat)


def _settings(chosen: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(f"{path}={json.dumps(value)}" for path, value in chosen.items())


def _groups(shared: Sequence[Any], cells: Sequence[Mapping[str, Any]], repeats: int, done: set[Place]) -> list[Group]:
    """Return what is still to do: a group a cell, a spawn key a repeat."""
    return [
        Group(own, tuple((r, key(chosen, r)) for r in range(repeats) if (c, r) not in done))
        for c, (own, chosen) in enumerate(zip(shared, cells, strict=True))
    ]


def _engine(jobs: int, executor: Executor | None, scheduler: str) -> Engine:
    if executor is not None:
        return engine.given(executor)
    if scheduler:
        return engine.dask(scheduler)
    return engine.processes(jobs) if jobs > 1 else engine.here


def _performed(
    run: Engine, groups: Sequence[Group], journal: Journal, tasks: int, watch: Watch | None, fail_fast: bool
) -> Iterator[Outcome]:
    """Do what is left, batch by batch into the journal, and yield it."""
    count = len(journal.places())
    for cell, batch, outcomes in run(repeats, groups):
        found = [o if isinstance(o, Outcome) else Outcome({}, f"sweep-worker: {o.reason}") for o in outcomes]
        journal.add([((cell, repeat), each) for (repeat, _), each in zip(batch, found, strict=True)])
        for each in found:
            count += 1
            if watch:
                watch(count, tasks, each.error)
            if each.error and fail_fast:
                raise WhidError("sweep-failed", f"{each.error} ({count} of {tasks} finished, all of them kept)")
            yield each


def repeats(shared: tuple[Study, Path, bool], tasks: Sequence[tuple[int, tuple[int, ...]]]) -> list[Outcome]:
    """Run repeats of one cell in memory, on full records if so asked; a fault is an outcome, not the end of the sweep."""
    study, base, full = shared
    why, clean = "asked for" if full else _records(study), Clean()
    seeds = [np.random.SeedSequence(study.seed, spawn_key=spawn_key) for _, spawn_key in tasks]
    with _seldom_collected():
        return [_outcome(flow.execute(study, base, s, clean) if why else flow.execute_drawn(study, s), why) for s in seeds]


@contextmanager
def _seldom_collected() -> Iterator[None]:
    """Look for cycles of garbage once in so many objects: at Python's own pace they cost a tenth of a drawn repeat."""
    before = gc.get_threshold()
    gc.set_threshold(OBJECTS, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _records(study: Study) -> str:
    """Return why repeats need whole records, "" where their statistics are drawn."""
    try:
        return flow.records_needed(study)
    except WhidError as fault:  # the repeats will say so themselves
        return str(fault)


def _outcome(result: Result, why: str) -> Outcome:
    if result.error:
        return Outcome({}, f"{result.error.code}: {result.error.message}", why)
    numbers = {name: m if isinstance(m, Measured) else Measured(m, float("nan")) for name, m in result.metrics.items()}
    return Outcome({name: (float(m.value), float(m.std)) for name, m in numbers.items()}, "", why)


def _write(found: SweepResult, folder: RunFolder, origin: Mapping[str, Any]) -> SweepResult:
    """Draw, tabulate and write a sweep; a picture that fails costs nothing but itself."""
    pictures, faults = plots.draw(found, folder.path)
    write_sweep(folder.path / "sweep.h5", {name: getattr(found, name) for name in KEPT}, origin, units)
    folder.write("config.yaml", origin["config"])
    tables = (found.table(), found.failures())
    shown = [markdown(table) for table in tables if table.rows] + [f"![{name}]({name})" for name in pictures] + list(faults)
    folder.write("summary.md", "\n\n".join(shown) + "\n")
    folder.write("sweep.csv", as_csv(tables[0]))
    return replace(found, pictures=pictures)
