"""A file or a mapping → Study, with overrides; and back to text."""

from __future__ import annotations

import copy
import json
import pathlib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

from pydantic_core import ValidationError

from whid.config.faults import faults, near
from whid.config.schema import validator
from whid.config.study import Study
from whid.config.yaml import Document, Path, dump, parse, spelled
from whid.errors import Faults, WhidError
from whid.files.text import read_text
from whid.kinds import plain
from whid.system import System

Overrides = Sequence[str] | Mapping[str, Any]


def load_study(source: str | pathlib.Path | Mapping[str, Any] | Study, overrides: Overrides = ()) -> Study:
    """Return the study of a YAML file (or of a mapping), with overrides applied: ["plant.noise.std=0.1"] or
    {"plant.noise.std": 0.1}.

    Raises `Faults` with every fault at once, each as `file:line:col: path: what is wrong, what is allowed`.

    >>> load_study({"name": "a"})
    Traceback (most recent call last):
    whid.errors.Faults: identify: is missing
    """
    return study_of(_document(source), _typed(overrides))


def load_variants(
    source: str | pathlib.Path | Mapping[str, Any] | Study, overrides: Sequence[str], variants: Sequence[Sequence[str]]
) -> Iterator[Study]:
    """Yield the study, without its `sweep:`, under overrides and one list of further ones after another.

    The text is parsed once, every variant is judged whole; raises `Faults`. A variant does not carry the lists that make a
    sweep: thousands of cells would have thousands of values each.

    >>> study = {"name": "a", "data": {"file": "a.csv", "dt": 1, "columns": {"input": "u", "output": "y"}},
    ...          "identify": {"kind": "fit"}}
    >>> [each.seed for each in load_variants(study, [], [["seed=1"], ["seed=2"]])]
    [1, 2]
    """
    document = _document(source)
    for override in overrides:
        _override(document, override)
    if isinstance(document.value, dict):
        document.value.pop("sweep", None)
        for places in (document.places, document.keys):
            for path in [path for path in places if path[:1] == ("sweep",)]:
                del places[path]
    for settings in variants:
        yield study_of(copy.deepcopy(document), settings)


def names_key(path: str | pathlib.Path, key: str) -> bool:
    """Tell whether a YAML file has a key at its top; what else stands in it is not judged, it may be no study at all."""
    value = parse(read_text(path), str(path)).value
    return isinstance(value, dict) and key in value


def _typed(overrides: Overrides) -> Sequence[str]:
    """Return overrides as they are typed after `--set`.

    >>> _typed({"seed": 3, "plant.noise.std": 0.1}), _typed("seed=3")
    (['seed=3', 'plant.noise.std=0.1'], ['seed=3'])
    """
    if isinstance(overrides, Mapping):
        return [f"{path}={json.dumps(_builtin(plain(value)))}" for path, value in overrides.items()]
    return [overrides] if isinstance(overrides, str) else overrides


def _document(source: str | pathlib.Path | Mapping[str, Any] | Study) -> Document:
    if isinstance(source, (str, pathlib.Path)):
        return parse(read_text(source), str(source))
    return Document(_builtin(plain(source)))


def as_system(tree: Mapping[str, Any] | str) -> System:
    """Return the system of a mapping, or of its YAML text, such as a result holds.

    >>> as_system("chain: [{kind: dead_zone, low: -1, high: 2}]").chain[0].high
    2.0
    """
    document = parse(tree) if isinstance(tree, str) else Document(_builtin(tree))
    system: System = _checked(document, System, [])
    return system


def study_of(document: Document, overrides: Sequence[str] = ()) -> Study:
    """Return the study that plain values declare; raise `Faults`."""
    found: list[WhidError] = []
    for override in overrides:
        try:
            _override(document, override)
        except Faults as error:
            found += error.faults
        except WhidError as error:
            found.append(error)
    study: Study = _checked(document, Study, found)
    return study


def resolved(study: Study) -> str:
    """Return a study as YAML text that loads as the same study."""
    return dump(plain(study))


def steps(path: str) -> Path:
    """Return a path as typed, `plant.chain[1].breaks` or `plant.chain.1.breaks`, in steps.

    >>> steps("plant.chain[1].breaks.0")
    ('plant', 'chain', 1, 'breaks', 0)
    """
    if not re.fullmatch(r"[^.\[\]\s]+(\.[^.\[\]\s]+|\[\d+\])*", path):
        raise WhidError("config-override", f"{path!r} is not a path such as plant.chain[1].breaks")
    return tuple(int(step) if step.isdecimal() else step for step in re.findall(r"[^.\[\]]+", path))


def _override(document: Document, text: str) -> None:
    """Set one value; a key that the file leaves out is added, and judged with the rest."""
    typed, equals, value = (part.strip() for part in text.partition("="))
    place = f"--set {typed}"
    if not equals:
        raise WhidError("config-override", "write it as path=value", place)
    new = parse(value, place).value
    here, path = document.value, cast(Path, ())
    *way, last = steps(typed)
    for step in way:
        here, path = _entry(here, path, step, place)
        key = path[-1]
        if isinstance(here, dict) and here.get(key) is None:
            if key not in here and near(str(key), here):
                raise WhidError("config-override", f"{spelled(path)} is not there{near(str(key), here)}", place)
            here[key], document.places[path] = {}, place
        here = here[key]
    here, path = _entry(here, path, last, place)
    here[path[-1]] = new
    document.replaced(path, place)


def _entry(here: Any, path: Path, step: str | int, place: str) -> tuple[Any, Path]:
    """Return the list or mapping that a step enters, and the path of the entry."""
    if isinstance(here, list) and len(here) == 1 and isinstance(step, str):
        here, path = here[0], (*path, 0)  # a list of one is as good as its entry
    if isinstance(here, list):
        if not isinstance(step, int) or step >= len(here):
            raise WhidError("config-override", f"{spelled(path)} is a list: its entries are 0 … {len(here) - 1}", place)
        return here, (*path, step)
    if not isinstance(here, dict):
        raise WhidError("config-override", f"{spelled(path) or 'the config'} holds no keys", place)
    return here, (*path, str(step))


def _checked(document: Document, cls: type, found: list[WhidError]) -> Any:
    """Return the object that plain values declare; raise what was found before together with what is wrong with them."""
    value = None
    try:
        value = validator(cls).validate_python(document.value)
    except ValidationError as error:
        found = found + faults(error.errors(include_url=False), document)
    if found:
        raise Faults(found)
    return value


def _builtin(value: Any) -> Any:
    """Return numpy's numbers and arrays as Python's, and mappings as dicts of their own."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _builtin(item) for key, item in value.items()}
    return [_builtin(item) for item in value] if isinstance(value, (list, tuple)) else value
