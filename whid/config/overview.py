"""A study in a few lines, for `whid check` and for logs."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from whid.config.memory import human, in_chunks, memory, whole
from whid.config.study import Study
from whid.files.source import DataSource
from whid.kinds import plain
from whid.quantity import Table
from whid.system import System


def overview(study: Study, base: Path = Path()) -> Table:
    """Return a table with one row a section of the study; base is the folder that data files are relative to."""
    rows: list[tuple[str, str]] = [("name", study.name), ("seed", str(study.seed))]
    if study.plant:
        rows.append(("plant", text_of(study.plant)))
    for experiment in study.experiment:
        samples = experiment.samples()
        rows.append((experiment.name, f"{samples} samples of {experiment.dt:.6g} s, {samples * experiment.dt:.6g} s in all"))
        rows += [("", brief(plain(part))) for part in experiment.parts]
        rows += [("adaptive", brief(asdict(experiment.adaptive)))] if experiment.adaptive else []
    rows += [(source.name, _source(source)) for source in study.sources]
    if study.model:
        rows.append(("model", text_of(study.model)))
    rows.append(("method", brief(plain(study.identify))))
    rows += [("expect", brief(plain(bound))) for bound in study.expect]
    if study.sweep:
        cells = " × ".join(f"{path} ({len(values)})" for path, values in study.sweep.over.items())
        rows.append(("sweep", f"{study.sweep.mode} over {cells}, {study.sweep.repeats} repeats"))
    needed, least = memory(study, base), in_chunks(study)
    chunked = "" if whole(study) or least >= needed else f"; {human(least)} in chunks, where that is more than allowed"
    rows.append(("memory", f"about {human(needed)}{chunked}"))
    return Table("", ("section", "what"), tuple(rows))


def _source(source: DataSource) -> str:
    """Return a measured record in one line: `time: t` is not read as two words."""
    keys = plain(source)
    for key in ("columns", "units"):
        if keys.get(key):
            keys[key] = "(" + ", ".join(f"{role}: {name}" for role, name in keys[key].items()) + ")"
    return brief({key: value for key, value in keys.items() if key != "name"})


def text_of(system: System) -> str:
    """Return a system in one line, the chain from input to output and its noise.

    >>> from whid.config.load import as_system
    >>> text_of(as_system("{chain: [{kind: dead_zone, low: -1, high: 2}], noise: {kind: white, std: 0.5}}"))
    'u → dead_zone(low -1, high 2) → y, noise white(std 0.5)'
    """
    tree = plain(system)
    noise = ", noise " + " + ".join(brief(one) for one in tree["noise"]) if tree.get("noise") else ""
    return f"u → {' → '.join(brief(block) for block in tree['chain'])} → y{noise}"


def brief(tree: Any) -> str:
    """Return plain values in one line: `kind(key value, …)`, blocks in series with arrows, in parallel with plus signs."""
    if isinstance(tree, dict):
        if isinstance(branches := tree.get("chain", tree.get("parallel")), list):
            return "(" + (" → " if "chain" in tree else " + ").join(brief(block) for block in branches) + ")"
        inner = ", ".join(f"{key} {brief(value)}" for key, value in tree.items() if key != "kind")
        return f"{tree['kind']}({inner})" if "kind" in tree and inner else str(tree.get("kind", inner))
    if isinstance(tree, list):
        return "[" + ", ".join(brief(item) for item in tree[:8]) + (f", … {len(tree)} in all]" if len(tree) > 8 else "]")
    if isinstance(tree, bool):
        return str(tree).lower()
    return f"{tree:.6g}" if isinstance(tree, float) else str(tree)
