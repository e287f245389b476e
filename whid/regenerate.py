"""The tables and figures of a config made anew, kept in a folder, and compared with what was expected.

load study ─► run its exhibits ─► Markdown, CSV, pictures in <out>/<name>-table-<hash10>/ ─► <config>.expected.csv
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from whid import flow
from whid.config.load import load_study, names_key, resolved
from whid.config.study import Study
from whid.errors import WhidError
from whid.files import expected, run_folder
from whid.files.expected import Cells
from whid.files.provenance import provenance
from whid.files.run_folder import RunFolder
from whid.kinds import plain
from whid.papers._exhibit import COLUMNS, Bench, Exhibit, Regenerated
from whid.quantity import Table
from whid.result import Check, Result
from whid.tables import markdown

Watch = Callable[[str, int, int], None]  # kind of the exhibit, finished runs, of how many


class Tables(NamedTuple):
    """What the exhibits of one config came out as; `drift`: every cell that is not as expected, None if not compared."""

    name: str
    found: Mapping[str, Regenerated]  # by kind, numbered from the second of a kind on
    path: Path
    files: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    drift: tuple[str, ...] | None = None

    @property
    def bars(self) -> tuple[Check, ...]:
        """Return the bars of all exhibits."""
        return tuple(bar for one in self.found.values() for bar in one.bars)

    @property
    def exit_code(self) -> int:
        """Return 4 for a drift or a breached bar, 5 for a bar that was not measured, else 0."""
        verdicts = {bar.verdict for bar in self.bars}
        return 4 if self.drift or "breached" in verdicts else 5 if "not measured" in verdicts else 0


def regenerate(
    config: str | Path,
    out: str | Path = "runs",
    *,
    full: bool = False,
    check: bool = False,
    watch: Watch = lambda kind, done, of: None,
) -> Tables:
    """Make the tables of a config anew, always by running: `--check` is there to find what the code changed.

    full: with the bars' own counts. check: compare with `<config>.expected.csv`, which is for the quick counts. Raises
    `WhidError("table-none")` for a study without `table:`, `WhidError("table-expected")` for nothing to compare with.
    """
    study = load_study(config)
    if not study.table:
        raise WhidError("table-none", "this study has no `table:` section", str(config))
    wanted = expected.read(expected.beside(Path(config))) if check else None
    origin = provenance(resolved(study) + ("# full\n" if full else ""), ())
    with RunFolder(Path(out), run_folder.stem(f"{study.name}-table", origin["hash"])) as folder:
        found: dict[str, Regenerated] = {}
        for exhibit in study.table:
            name = _numbered(exhibit.kind, found)
            found[name] = exhibit(bench_of(study, Path(config).parent, exhibit, full, watch))
        cells = [
            Cells(name, row.quantity, {column: getattr(row, column) for column in COLUMNS}, row.tolerance)
            for name, one in found.items()
            for row in one.rows
        ]
        files, warnings = [expected.beside(Path(config)).name, "table.md"], []
        folder.write(files[0], expected.text(cells))
        folder.write(
            files[1], "\n\n".join(markdown(t) for one in found.values() for t in (one.table(), bars(one.bars))) + "\n"
        )
        for name, one in found.items():
            if one.draw is not None:
                try:
                    _picture(one, folder.path / f"{name}.png")
                    files.append(f"{name}.png")
                except Exception as fault:  # the numbers are worth more
                    warnings.append(f"picture {name} not drawn: {type(fault).__name__}: {fault}")
        folder.write("config.yaml", origin["config"])
        drift = None if wanted is None else tuple(expected.drift(wanted, cells))
        return Tables(study.name, found, folder.keep(origin["hash"]), tuple(files), tuple(warnings), drift)


def with_tables(root: str | Path) -> list[Path]:
    """Return the configs below a folder that have a `table:`; raise `WhidError("table-none")` if none has."""
    found = [path for path in sorted(Path(root).rglob("*.yaml")) if names_key(path, "table")]
    if not found:
        raise WhidError("table-none", "no config with a `table:` section below this folder", str(root))
    return found


def bench_of(study: Study, base: Path, exhibit: Exhibit, full: bool, watch: Watch) -> Bench:
    """Return a bench for one exhibit of a study; a run's seed is keyed by what it changes and its number."""

    def execute(changes: Mapping[str, Any], repeat: int) -> Result:
        digest = hashlib.sha256(json.dumps(plain(dict(changes)), sort_keys=True, default=str).encode()).digest()
        key = (*np.frombuffer(digest[:16], np.uint32).tolist(), repeat)
        return flow.execute(replace(study, **changes), base, np.random.SeedSequence(study.seed, spawn_key=key))

    def generator(key: Sequence[int]) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=tuple(key)))

    count = exhibit.full_runs if full and exhibit.full_runs else exhibit.runs
    return Bench(
        study.plant, study.experiment, study.identify, study.seed, count, full, execute, generator,
        lambda done, of: watch(exhibit.kind, done, of),
    )  # fmt: skip


def bars(checks: Sequence[Check]) -> Table:
    """Return bars as a table."""
    from whid.summary import expected as as_table

    return as_table(checks)._replace(title="Bars" if checks else "")


def _picture(found: Regenerated, path: Path) -> None:
    from whid.plots._style import save

    save(lambda _, figure: found.draw(figure), None, path)  # type: ignore[misc]


def _numbered(kind: str, taken: Mapping[str, Any]) -> str:
    number = 2
    name = kind
    while name in taken:
        name, number = f"{kind}_{number}", number + 1
    return name
