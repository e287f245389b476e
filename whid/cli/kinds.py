"""List every block, disturbance, experiment part, column operation, method, effect and table of a paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from whid.errors import WhidError

if TYPE_CHECKING:
    from whid.kinds import Kind
    from whid.quantity import Table


@click.command()
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(name: str | None, as_json: bool) -> None:
    """List what a config may name by `kind:`, one line each; NAME is a family (blocks) or a kind (dead_zone).

    Example: whid kinds blocks; whid kinds dead_zone
    """
    from whid.cli._print import print_json, print_tables

    families = _families()
    chosen = [base for base in families if name in (None, _family(base))]
    kinds = [base.named(name) for base in families if name in base.kinds()] if name else []
    if not chosen and not kinds:
        raise WhidError("config-kind", _unknown(name or "", families))
    tables = [_keys(kind) for kind in kinds] or [_listed(chosen)]
    if as_json:
        print_json(tables)
        return
    for kind in kinds:
        click.echo((kind.__doc__ or "").partition(">>>")[0].rstrip() + "\n")
    print_tables(*tables)


def _families() -> tuple[type[Kind], ...]:
    from whid.blocks._block import Block
    from whid.disturbances._disturbance import Disturbance
    from whid.effects._effect import Effect
    from whid.experiments._part import Part
    from whid.methods._method import Method
    from whid.operations._operation import Operation
    from whid.papers._exhibit import Exhibit

    return Block, Disturbance, Part, Operation, Method, Effect, Exhibit


def _family(base: type[Kind]) -> str:
    return base.family.rpartition(".")[2]


def _listed(bases: list[type[Kind]]) -> Table:
    from whid.quantity import Table

    rows = tuple((_family(base), kind, base.named(kind).summary()) for base in bases for kind in base.kinds())
    return Table("", ("family", "kind", "what it is"), rows)


def _keys(kind: type[Kind]) -> Table:
    from whid.config.schema import json_schema
    from whid.quantity import Table

    whole = json_schema(kind)
    schema = whole["$defs"][whole["$ref"].rpartition("/")[2]] if "$ref" in whole else whole
    rows = []
    for key, value in schema["properties"].items():
        needed = key in schema.get("required", ())
        default = "required" if needed else "" if value.get("default") is None else str(value["default"]).lower()
        rows.append((key, words(value), default))
    return Table("", ("key", "value", "default"), tuple(rows))


def words(schema: dict[str, Any]) -> str:
    """Return what a JSON Schema allows, in words.

    >>> words({"type": "array", "items": {"type": "number", "exclusiveMinimum": 0}, "minItems": 1})
    'list of number > 0'
    """
    if "oneOf" in schema:
        found = [words(one) for one in schema["oneOf"] if one.get("type") != "null"]
        return " or ".join(one for one in found if f"list of {one}" not in found)  # one mapping may stand for a list
    if "const" in schema or "enum" in schema:
        return " | ".join(str(one) for one in schema.get("enum", [schema.get("const")]))
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    if schema.get("type") == "array":
        fixed = ", ".join(words(one) for one in schema.get("prefixItems", ()))
        return f"list of {fixed or words(schema.get('items', {}))}"
    signs = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
    limits = "".join(f" {sign} {schema[key]:g}" for key, sign in signs.items() if key in schema)
    names = {"boolean": "true | false", "integer": "whole number", "string": "text", "object": "mapping"}
    form = str(schema.get("type", "anything"))
    return names.get(form, form) + limits


def _unknown(name: str, families: tuple[type[Kind], ...]) -> str:
    import difflib

    near = difflib.get_close_matches(name, [kind for base in families for kind in (*base.kinds(), _family(base))], n=1)
    return f"no kind or family {name!r}{f', did you mean {near[0]}?' if near else ''}"
