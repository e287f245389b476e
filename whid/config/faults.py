"""What pydantic found wrong → faults in plain words, each with its place and what is allowed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import Any

from whid.config.schema import WORDS, keys, shape
from whid.config.yaml import Document, Path
from whid.errors import WhidError

LIMITS = {
    "greater_than": ("gt", ">"),
    "greater_than_equal": ("ge", ">="),
    "less_than": ("lt", "<"),
    "less_than_equal": ("le", "<="),
}


def faults(errors: Iterable[Mapping[str, Any]], document: Document) -> list[WhidError]:
    """Return every error as a `WhidError` with `file:line:col: path`, in the order of the file."""
    found = [_fault(error, document) for error in errors if not _echo(error)]
    return sorted(found, key=lambda fault: [int(number) for number in re.findall(r":(\d+)(?=:)", fault.where)[:2]])


def near(word: str, allowed: Iterable[str]) -> str:
    """Return ", did you mean …?" where a name is near, else nothing.

    >>> near("chian", ["chain", "linear"])
    ', did you mean chain?'
    """
    found = difflib.get_close_matches(word, list(allowed), n=1)
    return f", did you mean {found[0]}?" if found else ""


def _echo(error: Mapping[str, Any]) -> bool:
    """Tell whether a list is called too short only because its entries have faults of their own."""
    return bool(error["type"] == "too_short" and len(error["input"]) >= error["ctx"]["min_length"])


def _fault(error: Mapping[str, Any], document: Document) -> WhidError:
    location, context, value = error["loc"], error.get("ctx", {}), error["input"]
    path: Path = tuple(step for step in location if not _is_label(step) and step != "[key]")
    what, where = error["type"], document.where(path)
    if what == "missing":
        return WhidError("config-missing", "is missing", where)
    if what == "extra_forbidden":
        return _unknown(location, document)
    if what == "kind":
        return _kind(value, context, document, path)
    if what == "whid":
        inside = [int(step) if step.isdecimal() else step for step in context["where"].split(".")]
        place = document.where((*path, *inside)) if context["where"] else where
        return WhidError(context["code"], context["text"], place)
    return WhidError("config-value", _value(what, value, context, error["msg"]), where)


def _unknown(location: tuple[Any, ...], document: Document) -> WhidError:
    *way, key = location
    allowed = keys([step for step in way if _is_label(step)][-1])
    path = (*(step for step in way if not _is_label(step)), key)
    message = f"unknown key{near(str(key), allowed)} (allowed: {', '.join(allowed)})"
    return WhidError("config-unknown", message, document.where(path, key=True))


def _is_label(step: Any) -> bool:
    return isinstance(step, str) and step.startswith("<")


def _kind(value: dict[str, Any], context: Mapping[str, Any], document: Document, path: Path) -> WhidError:
    kinds, family = context["kinds"].split(), context["family"].rpartition(".")[2]
    there = f"({family}: {', '.join(kinds)})"
    if "kind" not in value:
        return WhidError("config-kind", f"needs `kind:` {there}", document.where(path))
    named = str(value["kind"])
    return WhidError(
        "config-kind", f"no kind {named[:40]!r}{near(named, kinds) or ' ' + there}", document.where((*path, "kind"))
    )


def _value(what: str, value: Any, context: Mapping[str, Any], said: str) -> str:
    """Return what is wrong with a value and what is allowed."""
    if what in ("shape", "text"):
        return f"must be {context['words']}, not {_shown(value)}"
    if what in LIMITS:
        name, sign = LIMITS[what]
        return f"must be {sign} {context[name]:g}, not {_shown(value)}"
    if what == "literal_error":
        names = re.findall(r"'([^']*)'", str(context["expected"]))
        return f"must be one of {', '.join(names)}, not {_shown(value)}{near(str(value), names)}"
    if what in ("too_short", "string_too_short"):
        return f"needs at least {context['min_length']} {'entry' if what == 'too_short' else 'character'}"
    if what == "int_type":
        return f"must be a whole number, not {_shown(value)}"
    if what in ("finite_number", "float_type"):  # the second: a whole number beyond 1e308
        return "must be a finite number"
    return said[:1].lower() + said[1:]


def _shown(value: Any) -> str:
    """Return a value, short, or what it is."""
    form = shape(value)
    if form in ("list", "mapping", "nothing", "flag"):
        return str(value).lower() if form == "flag" else WORDS[form]
    text = repr(value)
    return f"{'the text ' if form == 'text' else ''}{text if len(text) <= 40 else text[:37] + '…'}"
