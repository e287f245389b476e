"""A study over a grid of values, many times: every cell and repeat is one identification with a seed of its own."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid import flow
from whid.config.load import load_study, resolved
from whid.config.study import Study, Sweep
from whid.errors import WhidError
from whid.files import run_folder
from whid.files.provenance import provenance
from whid.files.run_folder import RunFolder
from whid.files.source import locate
from whid.files.sweep_file import read_sweep, write_sweep
from whid.quantity import Cell, Measured, Table
from whid.result import Check
from whid.score import units
from whid.tables import cell as as_text
from whid.tables import markdown

Floats = NDArray[np.float64]
Watch = Callable[[int, int], None]  # finished, of how many


class Outcome(NamedTuple):
    """One repeat of one cell: its metrics with their standard errors, or why there are none."""

    metrics: Mapping[str, tuple[float, float]]
    error: str = ""


@dataclass(frozen=True, eq=False)
class SweepResult:
    """What a sweep found: cells × repeats.

    over    the values of every swept path, one a cell
    values  metric → (cells, repeats), NaN where it failed or is not measured; std likewise
    errors  (cells, repeats) why a repeat failed, "" where it did not
    """

    name: str
    over: Mapping[str, tuple[Any, ...]]
    values: Mapping[str, Floats]
    std: Mapping[str, Floats]
    errors: NDArray[Any]
    checks: tuple[Check, ...]
    path: Path | None = None
    reused: bool = False

    @property
    def failed(self) -> int:
        """Return how many repeats failed."""
        return int((self.errors != "").sum())

    def table(self, metrics: Sequence[str] = ()) -> Table:
        """Return one row a cell and metric: mean, standard deviation and their count; by default what `expect:` names
        and every metric that is not of a single frequency.
        """
        named = list(dict.fromkeys([*metrics, *(check.metric for check in self.checks)]))
        chosen = named or [name for name in self.values if "@" not in name]
        rows: list[tuple[Cell, ...]] = []
        for c in range(len(self.errors)):
            place = tuple(as_text(values[c]) for values in self.over.values())
            for name in chosen:
                found = self.values.get(name, np.full(self.errors.shape, np.nan))[c]
                found = found[np.isfinite(found)]
                mean = float(found.mean()) if len(found) else float("nan")
                sd = float(found.std(ddof=1)) if len(found) > 1 else float("nan")
                failures = int((self.errors[c] != "").sum())
                rows.append((*place, name, Measured(mean, sd / np.sqrt(max(len(found), 1))), sd, len(found), failures))
        columns = (*self.over, "metric", "mean ± its error", "sd", "n", "failed")
        return Table(f"Sweep {self.name}", columns, tuple(rows))


def sweep(
    config: str | Path | Mapping[str, Any],
    out: str | Path = "runs",
    overrides: Sequence[str] = (),
    *,
    jobs: int = 1,
    executor: Executor | None = None,
    force: bool = False,
    watch: Watch | None = None,
) -> SweepResult:
    """Run the study of a config over its `sweep:` and keep the outcome in `<out>/<name>-sweep-<hash10>/`.

    jobs > 1 uses that many processes, executor any other `concurrent.futures` engine; the numbers are the same, bit for bit:
    every repeat's seed is a `SeedSequence` keyed by the study's seed, the cell's values and the repeat. A bound of
    `expect:` holds when the mean of every cell holds it. A sweep that is done is not run again, unless `force`.
    Raises `WhidError` for a faulty config or one without `sweep:`.
    """
    study = load_study(config, overrides)
    if study.sweep is None:
        raise WhidError("sweep-missing", "this study has no `sweep:` section")
    cells = [dict(zip(study.sweep.over, values, strict=True)) for values in combinations(study.sweep)]
    for chosen in cells:
        load_study(config, [*overrides, *_settings(chosen)])  # every cell's faults before the first run
    base = Path(config).parent if isinstance(config, (str, Path)) else Path()
    origin = provenance(resolved(study), [locate(source.file, base) for source in study.sources])
    stem = run_folder.stem(f"{study.name}-sweep", origin["hash"])
    if not force and (done := run_folder.finished(Path(out), stem)):
        return _result(study, *read_sweep(done / "sweep.h5"), path=done, reused=True)
    repeats = range(study.sweep.repeats)
    tasks = [(config, (*overrides, *_settings(chosen)), key(chosen, r)) for chosen in cells for r in repeats]
    outcomes = list(_outcomes(tasks, jobs, executor, watch))
    shape = (len(cells), study.sweep.repeats)
    names = list(dict.fromkeys(name for outcome in outcomes for name in outcome.metrics))
    missing = (float("nan"), float("nan"))
    numbers = {name: np.array([o.metrics.get(name, missing) for o in outcomes]).reshape(*shape, 2) for name in names}
    over = {path: tuple(chosen[path] for chosen in cells) for path in study.sweep.over}
    values, std = ({name: both[..., side] for name, both in numbers.items()} for side in (0, 1))
    errors = np.array([o.error for o in outcomes], object).reshape(shape)
    with RunFolder(Path(out), stem) as folder:
        write_sweep(folder.path / "sweep.h5", over, values, std, errors, origin, units)
        folder.write("config.yaml", origin["config"])
        found = _result(study, over, values, std, errors)
        folder.write("summary.md", markdown(found.table()) + "\n")
        return replace(found, path=folder.keep(origin["hash"]))


def load(path: str | Path) -> SweepResult:
    """Return the outcome kept in a sweep's folder."""
    folder = Path(path)
    return _result(load_study(folder / "config.yaml"), *read_sweep(folder / "sweep.h5"), path=folder)


def _result(
    study: Study,
    over: Mapping[str, tuple[Any, ...]],
    values: Mapping[str, Floats],
    std: Mapping[str, Floats],
    errors: NDArray[Any],
    path: Path | None = None,
    reused: bool = False,
) -> SweepResult:
    checks = tuple(_check(bound.metric, values, bound.below, bound.above) for bound in study.expect)
    return SweepResult(study.name, over, values, std, errors, checks, path, reused)


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


def _outcomes(
    tasks: Sequence[tuple[Any, tuple[str, ...], tuple[int, ...]]], jobs: int, executor: Executor | None, watch: Watch | None
) -> Iterator[Outcome]:
    """Yield outcomes in the order of the tasks, whoever does them."""
    if executor is None and jobs > 1:
        with _single_threaded(), ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            yield from _outcomes(tasks, jobs, pool, watch)
        return
    done = executor.map(_outcome, tasks, chunksize=max(1, len(tasks) // (8 * jobs))) if executor else map(_outcome, tasks)
    for count, outcome in enumerate(done, 1):
        if watch:
            watch(count, len(tasks))
        yield outcome


def _outcome(task: tuple[Any, tuple[str, ...], tuple[int, ...]]) -> Outcome:
    """Run one repeat in memory; a fault is an outcome, not the end of the sweep."""
    config, overrides, spawn_key = task
    study = load_study(config, overrides)
    base = Path(config).parent if isinstance(config, (str, Path)) else Path()
    result = flow.execute(study, base, np.random.SeedSequence(study.seed, spawn_key=spawn_key))
    if result.error:
        return Outcome({}, f"{result.error.code}: {result.error.message}")
    numbers = {name: m if isinstance(m, Measured) else Measured(m, float("nan")) for name, m in result.metrics.items()}
    return Outcome({name: (m.value, m.std) for name, m in numbers.items()})


class _single_threaded:
    """Start workers with one BLAS thread each: they inherit the environment before they import numpy."""

    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

    def __enter__(self) -> None:
        self.before = {name: os.environ.get(name) for name in self.names}
        os.environ.update(dict.fromkeys(self.names, "1"))

    def __exit__(self, *_: object) -> None:
        for name, value in self.before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def _check(metric: str, values: Mapping[str, Floats], below: float | None, above: float | None) -> Check:
    """Hold a bound against the cell mean that comes nearest to breaking it; a cell without a number breaks it."""
    if metric not in values:
        return Check(metric, None, below, above)
    means = np.array([row[np.isfinite(row)].mean() if np.isfinite(row).any() else np.nan for row in values[metric]])
    verdicts = [Check(metric, float(mean), below, above) for mean in means]
    worst = next((check for check in verdicts if check.verdict != "pass"), None)
    return worst or max(verdicts, key=lambda check: check.value or 0.0)
