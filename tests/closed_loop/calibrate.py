"""The calibration sweep of the closed loop: hidden effects, unseen plants, a confusion matrix.

python -m tests.closed_loop.calibrate configs/closed_loop/calibration.yaml [--jobs 2] [--minutes 20] [--set plants=2]

A cell runs what `whid trace` runs, in memory: no pictures, no files. One that takes longer than `limit_s` of CPU time counts
as abstained, said "timed out"; one that fails is a row with its reason.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from tests.closed_loop.case import NotVisible, draw_case, write
from tests.closed_loop.hidden import EFFECTS, OUTSIDE
from tests.closed_loop.score import Score, score
from tests.closed_loop.tables import page, picture
from whid import engine, flow
from whid.config.load import load_study
from whid.engine import Engine, Group
from whid.trace import as_object

Watch = Callable[["Row"], None]
ATTEMPTS = 6  # plants, until one can show the effect at the size


@dataclass(frozen=True)
class Calibration:
    """What the YAML file declares."""

    name: str
    seed: int = 50000
    effects: tuple[str, ...] | str = "all"
    sizes: tuple[float, ...] = (0.1, 0.5, 3.0)
    plants: int = 10
    controls: int = 200
    pairs: int = 40
    outside: int = 10
    limit_s: float = 60.0

    @classmethod
    def read(cls, path: Path, overrides: Sequence[str] = ()) -> Calibration:
        """Return the calibration of a file, some values replaced (KEY=VALUE)."""
        values = yaml.safe_load(path.read_text()) | {k: yaml.safe_load(v) for k, v in (o.split("=", 1) for o in overrides)}
        if unknown := set(values) - {field.name for field in fields(cls)}:
            raise SystemExit(f"{path}: no such key: {', '.join(sorted(unknown))}")
        found = cls(**{k: tuple(v) if isinstance(v, list) else v for k, v in values.items()})
        if unknown := set(found.names) - set(EFFECTS):
            raise SystemExit(f"{path}: no such effect: {', '.join(sorted(unknown))}; there are {', '.join(EFFECTS)}")
        return found

    @property
    def names(self) -> tuple[str, ...]:
        """Return the effects."""
        return tuple(EFFECTS) if self.effects == "all" else tuple(self.effects)

    def cells(self) -> list[Cell]:
        """Return every cell, in an order whose beginning is a fair sample of the whole."""
        rows: list[tuple[float, Cell]] = []

        def spread(cells: list[Cell]) -> None:
            order = np.random.default_rng(self.seed).permutation(len(cells))
            rows.extend(((place + 0.5) / len(cells), cells[k]) for place, k in enumerate(order))

        catalogue, outside, limit = [*EFFECTS], [*OUTSIDE], self.limit_s
        spread([Cell("control", (), 0.0, self.seed + 7 * k, k % 2 == 1, limit) for k in range(self.controls)])
        spread(
            [
                Cell("one", (name,), size, self.seed + 100_000 + 1000 * catalogue.index(name) + 10 * k, k % 5 == 4, limit)
                for k in range(self.plants) for name in self.names for size in self.sizes
            ]
        )  # fmt: skip
        spread(
            [
                Cell("outside", (name,), size, self.seed + 200_000 + 1000 * outside.index(name) + 10 * k, False, limit)
                for k in range(self.outside) for name in OUTSIDE for size in self.sizes
            ]
        )  # fmt: skip
        large = [size for size in self.sizes if size >= 0.5] or list(self.sizes)
        spread(
            [Cell("two", (), large[k % len(large)], self.seed + 300_000 + 10 * k, False, limit) for k in range(self.pairs)]
        )
        return [cell for _, cell in sorted(rows, key=lambda row: row[0])]


class Cell(NamedTuple):
    """One record to be traced."""

    group: str  # control, one, two, outside
    effects: tuple[str, ...]  # of `two` drawn from the seed
    size: float
    seed: int
    coloured: bool
    limit_s: float = np.inf  # of CPU time, for the tracing alone

    @property
    def key(self) -> str:
        """Return its name, which a resumed sweep knows it by."""
        return f"{self.group}:{'+'.join(self.effects)}:{self.size:g}:{self.seed}:{int(self.coloured)}"


@dataclass(frozen=True)
class Row:
    """What became of a cell: one line of cells.csv."""

    key: str
    group: str
    hidden: str
    size: float
    seed: int
    family: str
    coloured: bool
    random: bool
    outcome: str
    said: str
    over: float
    seconds: float
    note: str = ""


def run(cell: Cell) -> Row:
    """Draw a cell's case, have it traced, score the answer. Effects that no plant of the cell shows are `not visible`."""
    case, hidden = _drawn(cell)
    row = Row(cell.key, cell.group, "+".join(hidden), cell.size, cell.seed, "", cell.coloured, False, "", "", np.nan, np.nan)
    if case is None:
        return replace(row, outcome="not visible")
    row = replace(row, family=case.truth["family"], random=case.truth["random"])
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        study = write(case, Path(folder))
        try:
            with limited(cell.limit_s):
                answer, note = traced(study)
        except OutOfTime:
            return replace(row, outcome="abstained", said="timed out", seconds=time.process_time() - began)
    seconds = time.process_time() - began
    found: Score = score(case.truth, answer)
    return replace(row, outcome=found.outcome, said=found.said, over=found.over, seconds=seconds, note=note)


class OutOfTime(BaseException):
    """A cell has had its time. No `Exception`: the flow would take it for a fault of its own and go on."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `OutOfTime` once so much CPU time has been used inside; only a process's main thread can be stopped so."""
    if not np.isfinite(seconds) or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: object) -> None:
        raise OutOfTime

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def _drawn(cell: Cell) -> tuple[Any, tuple[str, ...]]:
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([cell.seed, attempt, 5])
        hidden = cell.effects or (_pair(rng) if cell.group == "two" else ())
        try:
            return draw_case(cell.seed + attempt, hidden, cell.size, coloured=cell.coloured), hidden
        except NotVisible:
            continue
    return None, cell.effects


def _pair(rng: np.random.Generator) -> tuple[str, str]:
    """Return two effects of different kinds at different places."""
    while True:
        one, two = (str(name) for name in rng.choice([*EFFECTS], 2, replace=False))
        if EFFECTS[one].place != EFFECTS[two].place and EFFECTS[one].kind != EFFECTS[two].kind:
            return one, two


def traced(study: Path) -> tuple[dict[str, Any] | None, str]:
    """Return what `whid trace --json` prints of a study, or None and why there is no answer."""
    result = flow.execute(flow.to_trace(load_study(study)), study.parent, np.random.SeedSequence(0))
    if result.error is not None or "verdict" not in result.stages:
        return None, str(result.error)[:300]
    return as_object(result.stages["verdict"]), ""


def sweep(
    cells: Sequence[Cell], log: Path, run_all: Engine = engine.here, minutes: float = np.inf, watch: Watch | None = None
) -> list[Row]:
    """Return the rows of all cells that are done: those of `log`, and those run now, appended to it one by one."""
    known = {row.key: row for row in _read(log)}
    todo = [cell for cell in cells if cell.key not in known]
    end = time.monotonic() + 60 * minutes
    if not todo or minutes <= 0:
        return [known[cell.key] for cell in cells if cell.key in known]
    with log.open("a") as file:
        for _, batch, rows in run_all(work, [Group(None, (cell,)) for cell in todo]):
            for cell, found in zip(batch, rows, strict=True):
                row = found if isinstance(found, Row) else _failed(cell, found.reason)
                known[row.key] = row
                file.write(json.dumps(asdict(row)) + "\n")
                file.flush()
                if watch:
                    watch(row)
            if time.monotonic() > end:
                break
    return [known[cell.key] for cell in cells if cell.key in known]


def work(shared: None, cells: Sequence[Cell]) -> list[Row]:
    """Run cells; what goes wrong in the harness itself is a failed row, not the end of the sweep."""
    rows = []
    for cell in cells:
        try:
            rows.append(run(cell))
        except Exception as fault:
            rows.append(_failed(cell, f"{type(fault).__name__}: {fault}"))
    return rows


def _failed(cell: Cell, reason: str) -> Row:
    return Row(cell.key, cell.group, "+".join(cell.effects), cell.size, cell.seed, "", cell.coloured, False, "failed", "",
               np.nan, np.nan, reason)  # fmt: skip


def _read(log: Path) -> Iterator[Row]:
    if log.exists():
        yield from (Row(**json.loads(line)) for line in log.read_text().splitlines() if line.endswith("}"))


def report(rows: Sequence[Row], folder: Path, title: str) -> str:
    """Write cells.csv, summary.md and confusion.png; return the page."""
    with (folder / "cells.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Row)])
        table.writeheader()
        table.writerows(asdict(row) for row in rows)
    text = page(rows, title)
    (folder / "summary.md").write_text(text)
    picture(rows, folder / "confusion.png", title)
    return text


def _tell(row: Row) -> None:
    print(f"{row.outcome:11s} {row.hidden or 'nothing'} {row.size:g} {row.family}: {row.said} {row.note}", flush=True)


def main(arguments: Sequence[str] | None = None) -> Path:
    """Run the sweep of a file and print its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--scheduler", default="", help="of a Dask cluster, tcp://…")
    parser.add_argument("--minutes", type=float, default=np.inf, help="stop after so many; run again to go on")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--out", type=Path, default=Path("runs"))
    given = parser.parse_args(arguments)
    declared = Calibration.read(given.config, given.overrides)
    digest = hashlib.sha256(json.dumps(asdict(declared), sort_keys=True).encode()).hexdigest()[:10]
    folder = given.out / f"{declared.name}-{digest}"
    folder.mkdir(parents=True, exist_ok=True)
    cells = declared.cells()
    run_all = engine.dask(given.scheduler) if given.scheduler else engine.processes(given.jobs)
    run_all = engine.here if given.jobs == 1 and not given.scheduler else run_all
    rows = sweep(cells, folder / "cells.jsonl", run_all, given.minutes, _tell)
    print(report(rows, folder, f"{declared.name}, seeds from {declared.seed}: {len(rows)} of {len(cells)} cells"))
    return folder


if __name__ == "__main__":
    main()
