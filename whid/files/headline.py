"""The headline of a finished folder, read without its records: what `whid list` shows of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import h5py

from whid.result import Check

HEADLINES = ("report.rms", "selection.rms", "estimation.rms")  # the first that is there


class Headline(NamedTuple):
    """What a run, sweep or set of tables came to, in a few words."""

    kind: str
    words: str


def headline(folder: Path) -> Headline | None:
    """Return the headline of a folder that whid made, None of any other or of a file that cannot be read."""
    try:
        if (folder / "result.h5").is_file():
            with h5py.File(folder / "result.h5") as file:
                return _run(file)
        if (folder / "sweep.h5").is_file():
            with h5py.File(folder / "sweep.h5") as file:
                cells, repeats = file["failures"].shape
                failed = int((file["failures"].asstr()[()] != "").sum())
                return Headline("sweep", f"{cells} cells × {repeats}" + (f", {failed} failed" if failed else ""))
    except (OSError, KeyError, ValueError):
        return Headline("unreadable", "its file cannot be read")
    return Headline("tables", "see table.md") if (folder / "table.md").is_file() else None


def _run(file: h5py.File) -> Headline:
    kept = json.loads(file["provenance/result"].asstr()[()])
    metric = next((name for name in HEADLINES if name in file["metrics"]), None)
    words = [f"{metric} {float(file['metrics'][metric][()]):.6g}"] if metric else []
    verdicts = [Check(*row).verdict for row in kept["checks"]]
    words += [f"{verdicts.count(v)} {v}" for v in ("breached", "not measured", "pass") if v in verdicts]
    words += [f"incomplete: {kept['error'][1]}"] if kept["error"] else []
    return Headline("trace" if "verdict" in file["stages"] else "run", ", ".join(words))
