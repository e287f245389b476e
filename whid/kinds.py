"""Everything that a YAML mapping names by `kind`: one file per kind, the folder is the registry.

`kind: dead_zone` in a list of blocks is the class `DeadZone` in `blocks/dead_zone.py`. Listing the kinds of a
family reads the folder's file names and imports nothing; a kind is imported when it is asked for. A package of the user's
own adds kinds by entry points of the family's name (`whid.blocks`, `whid.effects`): `my_kind = package.my_kind:MyKind`.
"""

from __future__ import annotations

import dataclasses
import difflib
import importlib
import importlib.util
import pkgutil
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, Self

from whid.errors import WhidError


def yaml_key(field: str) -> str:
    """Return the YAML key of a dataclass field: `from_` is written `from` (a Python keyword)."""
    return field.rstrip("_")


class Kind:
    """Base of every family; its subclasses are frozen dataclasses whose fields are their YAML keys."""

    family: ClassVar[str] = ""  # the package that is the registry, e.g. "whid.blocks"
    kind: ClassVar[str] = ""  # the YAML name = the module's name

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        name = cls.__module__.rpartition(".")[2]
        cls.kind = "" if name.startswith("_") else name

    @classmethod
    def kinds(cls) -> tuple[str, ...]:
        """Return the family's kinds, read from its folder and from entry points without importing them."""
        return tuple(sorted({*_listed(cls.family), *_brought(cls.family)}))

    @classmethod
    def named(cls, kind: str) -> type[Self]:
        """Import and return the class of a kind; raise `WhidError` with the nearest name if there is none."""
        if kind not in cls.kinds():
            near = difflib.get_close_matches(kind, cls.kinds(), n=1)
            hint = f", did you mean {near[0]}?" if near else ""
            raise WhidError("config-kind", f"no {cls.family.rpartition('.')[2]} kind {kind!r}{hint}")
        if kind not in _listed(cls.family):
            brought: type[Self] = _brought(cls.family)[kind].load()
            return brought
        module = importlib.import_module(f"{cls.family}.{kind}")
        found: type[Self] = getattr(module, "".join(word.title() for word in kind.split("_")))
        return found

    @classmethod
    def package(cls) -> str:
        """Return the package and version that brought this kind, empty for whid's own."""
        entry = _brought(cls.family).get(cls.kind) if cls.kind not in _listed(cls.family) else None
        return f"{entry.dist.name} {entry.dist.version}" if entry is not None and entry.dist is not None else ""

    @classmethod
    def summary(cls) -> str:
        """Return the first line of the docstring, for `whid kinds`."""
        return (cls.__doc__ or "").strip().partition("\n")[0]


def plain(value: Any) -> Any:
    """Return a config value as YAML would hold it: mappings, lists and scalars, defaults left out.

    >>> from whid.blocks.dead_zone import DeadZone
    >>> plain(DeadZone(low=-1.0, high=2.0))
    {'kind': 'dead_zone', 'low': -1.0, 'high': 2.0}
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kind = value.kind if isinstance(value, Kind) else ""
        own = any(f.name == kind for f in dataclasses.fields(value))  # chain, parallel: the key says the kind
        return ({"kind": kind} if kind and not own else {}) | {
            yaml_key(f.name): plain(getattr(value, f.name))
            for f in dataclasses.fields(value)
            if getattr(value, f.name) != (f.default if f.default_factory is dataclasses.MISSING else f.default_factory())
        }
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return repr(value).strip("()") if isinstance(value, complex) else value


@lru_cache
def _brought(family: str) -> dict[str, metadata.EntryPoint]:
    """Return the kinds that installed packages bring, by name; the import of one happens when it is asked for."""
    return {entry.name: entry for entry in metadata.entry_points(group=family)} if family else {}


@lru_cache
def _listed(package: str) -> tuple[str, ...]:
    spec = importlib.util.find_spec(package)
    folders = list(spec.submodule_search_locations or []) if spec else []
    return tuple(sorted(m.name for m in pkgutil.iter_modules([str(Path(f)) for f in folders]) if m.name[0] != "_"))
