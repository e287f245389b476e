"""YAML text → plain values, and where in the file each one stands.

The YAML 1.2 core schema: `1e-3` is a number, `no` and `on` are words, `010` is ten. No tags, hence no objects; every
key once; anchors and merge keys (`<<`) within bounds. PyYAML parses, what its nodes mean is decided here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml

from whid.errors import Faults, WhidError

Path = tuple[str | int, ...]  # ("plant", "chain", 1, "breaks")

DEPTH = 50  # nested lists and mappings
DIGITS = 4000  # of an int; Python refuses to read 4300
ALIASED = 10_000  # values reached through anchors
TAGGED = "tags (`!…`) are not allowed: a config holds plain values"
CORE = (  # tag, pattern, first characters: YAML 1.2.2, section 10.3.2
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", list("-+.")),
    ("merge", r"<<", ["<"]),
)


@dataclass
class Document:
    """Plain values and the places of their paths."""

    value: Any
    file: str = ""
    places: dict[Path, str] = field(default_factory=dict)  # of values, "file:line:col"
    keys: dict[Path, str] = field(default_factory=dict)  # of the keys before them

    def where(self, path: Path, key: bool = False) -> str:
        """Return "file:line:col: path", the place of the nearest enclosing value that the file has."""
        place = self.keys.get(path, "") if key else ""
        for end in range(len(path), -1, -1):
            place = place or self.places.get(path[:end], "")
        typed = place.removeprefix("--set ")
        return ": ".join(part for part in (place or self.file, spelled(path)) if part and (part == place or part != typed))

    def replaced(self, path: Path, place: str) -> None:
        """Note that the value of a path now comes from elsewhere."""
        for places in (self.places, self.keys):
            for known in [known for known in places if known[: len(path)] == path]:
                del places[known]
        self.places[path] = place


def spelled(path: Path) -> str:
    """Return a path as people type it.

    >>> spelled(("plant", "chain", 1, "breaks"))
    'plant.chain[1].breaks'
    """
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).removeprefix(".")


def parse(text: str, file: str = "") -> Document:
    """Return the one document of a YAML text; raise `Faults` with every fault's file:line:col.

    >>> parse("{std: 1e-3, on: no, count: 010}").value
    {'std': 0.001, 'on': 'no', 'count': 10}
    """
    loader = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
    except yaml.YAMLError as error:
        raise Faults([WhidError("config-syntax", *_said(error, text, file))]) from None
    except (ValueError, OverflowError):  # PyYAML on "\UFFFFFFFF" or a %YAML line of 5000 digits
        line = loader.line + 1 if loader else 1
        raise Faults([WhidError("config-syntax", "an escape or number that YAML cannot hold", f"{file}:{line}:1")]) from None
    document = Document(None, file)
    if node is not None:
        reader = _Reader(document, loader.tagged)
        document.value = reader.read(node, ())
        if reader.faults:
            raise Faults(reader.faults)
    return document


def dump(value: Any) -> str:
    """Return plain values as YAML text that `parse` reads back as they are."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)


class _Loader(yaml.SafeLoader):
    """Composes nodes; refuses depth, remembers tags."""

    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012 (PyYAML's own attribute)

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.depth = 0
        self.tagged: set[int] = set()

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if self.depth > DEPTH:
            raise yaml.MarkedYAMLError(problem=f"nested deeper than {DEPTH}", problem_mark=event.start_mark)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        if getattr(event, "tag", None) is not None:
            self.tagged.add(id(node))
        return node


class _Dumper(yaml.SafeDumper):
    """Quotes what `_Loader` would not read as text."""

    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012

    def ignore_aliases(self, data: Any) -> bool:
        return True


for _tag, _pattern, _first in CORE:
    for _side in (_Loader, _Dumper):
        _side.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), _first)


class _Reader:
    """Turns nodes into values and notes places and faults."""

    def __init__(self, document: Document, tagged: set[int]) -> None:
        self.document, self.tagged = document, tagged
        self.faults: list[WhidError] = []
        self.seen: set[int] = set()
        self.inside: list[int] = []
        self.aliased = 0

    def read(self, node: yaml.Node, path: Path) -> Any:
        self.document.places[path] = self.place(node)
        if not self.enter(node, path):
            return None
        self.inside.append(id(node))
        value: Any = None
        if isinstance(node, yaml.MappingNode):
            value = {key: self.read(item, (*path, key)) for key, item in self.pairs(node, path)}
        elif isinstance(node, yaml.SequenceNode):
            value = [self.read(item, (*path, i)) for i, item in enumerate(node.value)]
        elif isinstance(node, yaml.ScalarNode):
            value = self.scalar(node, path)
        self.inside.pop()
        return value

    def enter(self, node: yaml.Node, path: Path) -> bool:
        """Tell whether a node may be read: no tag, not inside itself, not the ten-thousandth copy."""
        if id(node) in self.tagged:
            self.tagged.discard(id(node))
            self.fault(node, path, TAGGED)
        self.aliased += id(node) in self.seen
        self.seen.add(id(node))
        if id(node) in self.inside:
            self.fault(node, path, "an anchor that contains itself")
            return False
        if self.aliased == ALIASED + 1:
            self.fault(node, path, f"anchors expand to more than {ALIASED} values")
        return self.aliased <= ALIASED

    def pairs(self, node: yaml.MappingNode, path: Path, taken: set[str] | None = None) -> Iterator[tuple[str, yaml.Node]]:
        """Yield keys and values, the own ones before the merged ones; report bad and repeated keys.

        taken: of a mapping that is merged, the keys that stand already and win over its own.
        """
        own: set[str] = set() if taken is None else taken
        merged: list[yaml.Node] = []
        for key, item in node.value:
            if id(key) in self.tagged:
                self.fault(key, path, TAGGED)
            elif key.tag.endswith(":merge"):
                merged += item.value if isinstance(item, yaml.SequenceNode) else [item]
            elif not isinstance(key, yaml.ScalarNode) or not key.tag.endswith(":str"):
                self.fault(key, path, f"a key must be a name, not {_short(key)}")
            elif key.value not in own:
                own.add(key.value)
                self.document.keys[(*path, key.value)] = self.place(key)
                yield key.value, item
            elif taken is None:
                first = self.document.keys[(*path, key.value)].split(":")[-2]
                self.fault(key, (*path, key.value), f"the key stands twice, first in line {first}")
        for source in merged:
            if not isinstance(source, yaml.MappingNode):
                self.fault(source, path, "`<<` merges mappings only")
            elif self.enter(source, path):
                self.inside.append(id(source))
                yield from self.pairs(source, path, own)
                self.inside.pop()

    def scalar(self, node: yaml.ScalarNode, path: Path) -> Any:
        """Return null, a bool, an int, a float or text, by the tag the resolver found."""
        kind, text = node.tag.rpartition(":")[2], node.value
        if kind == "null":
            return None
        if kind == "bool":
            return text.lower() == "true"
        if kind == "int" and len(text) <= DIGITS:
            return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
        if kind in ("int", "float"):
            return float(re.sub(r"\.(?=inf|nan)", "", text.lower()))
        if any("\ud800" <= c <= "\udfff" for c in text):
            self.fault(node, path, "half a surrogate pair is not text")
            return ""
        return text

    def place(self, node: yaml.Node) -> str:
        mark = node.start_mark
        return f"{self.document.file or 'text'}:{mark.line + 1}:{mark.column + 1}"

    def fault(self, node: yaml.Node, path: Path, message: str) -> None:
        self.faults.append(WhidError("config-syntax", message, f"{self.place(node)}: {spelled(path)}".removesuffix(": ")))


def _short(node: yaml.Node) -> str:
    return repr(node.value[:40]) if isinstance(node, yaml.ScalarNode) else "a list or mapping"


def _said(error: yaml.YAMLError, text: str, file: str) -> tuple[str, str]:
    """Return PyYAML's complaint as (message, place), in plain words where its own are not."""
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
    if isinstance(error, yaml.reader.ReaderError):
        before = text[: error.position]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        return f"the character U+{ord(text[error.position]):04X} is not allowed in YAML", f"{file}:{line}:{column}"
    place = f"{file}:{mark.line + 1}:{mark.column + 1}" if mark else file
    if "but found another document" in str(error):
        return "a second document begins here (`---`); a config is one study: put each in a file of its own", place
    if "found character '\\t'" in (problem or ""):
        return "a tab: YAML indents with spaces", place
    context = getattr(error, "context", None)
    return "not YAML: " + ", ".join(part for part in (context, problem) if part), place
