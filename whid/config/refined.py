"""The refined study: the user's own, its model with what was missing, as text that `whid run` takes from any folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from whid.config.study import Study
from whid.config.yaml import dump
from whid.files.source import DataSource, locate
from whid.kinds import plain
from whid.methods.fit import Fit
from whid.refine._free import walk
from whid.system import System
from whid.trace import Verdict

LEAVE = "# the numbers are fitted already: `steps: 0` leaves them; take it out to fit again"


def refined_study(study: Study, stages: Mapping[str, Any], base: Path) -> str:
    """Return the YAML of a study whose model is the refined one, its numbers as fitted, its evidence in comments.

    The method is `fit` with no steps: a run evaluates the numbers as they stand, and so reproduces the error after.
    """
    verdict: Verdict = stages["verdict"]
    system = stages["model"].system
    coloured = any(noise.kind == "ar" for noise in system.noise)
    path: Literal["exact", "sampled"] = (
        "sampled" if any(experiment.path == "sampled" for experiment in study.experiment) else "exact"
    )
    new = replace(
        study, name=f"{study.name[:56]}-refined", model=system, trace=None, expect=(), sweep=None, table=(),
        data=None if study.data is None else _absolute(study.data, base),
        records=tuple(_absolute(source, base) for source in study.records),
        identify=Fit(steps=0, noise="ar" if coloured else "white", path=path),
    )  # fmt: skip
    said = {"model:": _evidence(verdict), "identify:": [LEAVE]}
    text = [*_head(study, verdict), *_packages(system)]
    for line in dump(plain(new)).splitlines():
        text += [*said.get(line.partition(" ")[0], []), line]
    return "\n".join(text) + "\n"


def _absolute(source: DataSource, base: Path) -> DataSource:
    return replace(source, file=str(locate(source.file, base).resolve()))


def _head(study: Study, verdict: Verdict) -> list[str]:
    where = "report data" if verdict.on == "report" else "the data it was fitted to (in sample, not evidence)"
    return [
        f"# {study.name}, refined by whid trace. {verdict.sentence}",
        f"# rms on {where}: {verdict.before.rms:.6g} before, {verdict.after.rms:.6g} after; noise floor {verdict.floor:.6g}",
    ]


def _packages(system: System) -> list[str]:
    """Return a line for every package that brought a block or disturbance of the model."""
    kinds = [block for _, block in walk(system.tree)]
    found = dict.fromkeys(p for kind in (*kinds, *system.noise) if (p := type(kind).package()))
    return [f"# needs {package}: pip install {package.replace(' ', '==')}" for package in found]


def _evidence(verdict: Verdict) -> list[str]:
    return [f"# added {found.name}: {found.words}; {found.gain:.1f} nat beyond its penalty" for found in verdict.effects]
