"""A file or a mapping → Study, with overrides; and back to text."""

from __future__ import annotations

import pathlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic_core import ValidationError

from whid.config.faults import faults, near
from whid.config.schema import validator
from whid.config.study import Study
from whid.config.yaml import Document, Path, dump, parse, spelled
from whid.errors import Faults, WhidError
from whid.files.text import read_text
from whid.kinds import plain


def load_study(source: str | pathlib.Path | Mapping[str, Any] | Study, overrides: Sequence[str] = ()) -> Study:
    """Return the study of a YAML file (or of a mapping), with overrides such as "plant.noise.std=0.1" applied.

    Raises `Faults` with every fault at once, each as `file:line:col: path: what is wrong, what is allowed`.

    >>> load_study({"name": "a"})
    Traceback (most recent call last):
    whid.errors.Faults: identify: is missing
    """
    if isinstance(source, (str, pathlib.Path)):
        return study_of(parse(read_text(source), str(source)), overrides)
    return study_of(Document(_builtin(plain(source))), overrides)


def study_of(document: Document, overrides: Sequence[str] = ()) -> Study:
    """Return the study that plain values declare; raise `Faults`."""
    found = []
    for override in overrides:
        try:
            _override(document, override)
        except Faults as error:
            found += error.faults
        except WhidError as error:
            found.append(error)
    try:
        study: Study = validator().validate_python(document.value)
    except ValidationError as error:
        found += faults(error.errors(include_url=False), document)
    if found:
        raise Faults(found)
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
    """Set one value; a key that the file leaves out is added and judged with the rest."""
    typed, equals, value_text = text.partition("=")
    place = f"--set {typed}"
    if not equals:
        raise WhidError("config-override", "write it as path=value", place)
    path, done, here = steps(typed.strip()), (), document.value
    value = parse(value_text, place).value
    for i, step in enumerate(path):
        last = i == len(path) - 1
        if isinstance(here, list) and len(here) == 1 and isinstance(step, str):
            here, done = here[0], (*done, 0)  # a list of one is as good as its entry
        if isinstance(here, list):
            if not isinstance(step, int) or step >= len(here):
                raise WhidError("config-override", f"{spelled(done)} is a list: its entries are 0 … {len(here) - 1}", place)
        elif not isinstance(here, dict):
            raise WhidError("config-override", f"{spelled(done) or 'the config'} holds no keys", place)
        elif not last and here.get(str(step)) is None:
            if str(step) not in here and near(str(step), here):
                raise WhidError("config-override", f"{spelled((*done, step))} is not there{near(str(step), here)}", place)
            here[str(step)] = {}
        key: Any = step if isinstance(here, list) else str(step)
        done = (*done, key)
        if last:
            here[key] = value
        else:
            here = here[key]
    document.replaced(done, place)


def _builtin(value: Any) -> Any:
    """Return numpy's numbers and arrays as Python's, and mappings as dicts of their own."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _builtin(item) for key, item in value.items()}
    return [_builtin(item) for item in value] if isinstance(value, (list, tuple)) else value
