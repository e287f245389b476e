"""Dataclass → pydantic: one core schema from the type hints, for checking configs and for editors.

Every place in a config is chosen by the shape of the YAML value (a number, text, a list, a mapping, …) and a mapping of
a family by its `kind`. So a fault is reported for the one alternative that was meant, never for all of them. A union's
label stands in pydantic's error location as "<…>"; that of a mapping is its class' name, from which the keys that are
allowed are known.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Callable
from functools import lru_cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import annotated_types as at
from pydantic_core import PydanticCustomError, SchemaValidator, core_schema
from pydantic_core.core_schema import CoreSchema

from whid.config.study import Match, Study
from whid.errors import WhidError
from whid.kinds import Kind, yaml_key

WORDS = {
    "nothing": "empty",
    "flag": "true or false",
    "number": "a number",
    "text": "text",
    "list": "a list",
    "mapping": "a mapping",
}
SCALARS: dict[Any, tuple[str, Callable[[], CoreSchema]]] = {
    NoneType: ("nothing", core_schema.none_schema),
    bool: ("flag", lambda: core_schema.bool_schema(strict=True)),
    float: ("number", lambda: core_schema.float_schema(strict=True, allow_inf_nan=False)),
    int: ("number", lambda: core_schema.int_schema(strict=True)),
    str: ("text", lambda: core_schema.str_schema(strict=True)),
}
CONSTRAINTS = {at.Gt: "gt", at.Ge: "ge", at.Lt: "lt", at.Le: "le", at.MinLen: "min_length", at.MaxLen: "max_length"}


@lru_cache
def validator(cls: type = Study) -> SchemaValidator:
    """Return the validator of a study, or of a part of one."""
    return SchemaValidator(_Builder().whole(cls))


def json_schema(cls: type = Study) -> dict[str, Any]:
    """Return the JSON Schema of a study, or of a part of one, for editors."""
    from pydantic.json_schema import GenerateJsonSchema

    class Generate(GenerateJsonSchema):
        """Describes a mapping by its class' docstring up to the first doctest."""

        def typed_dict_schema(self, schema: core_schema.TypedDictSchema) -> dict[str, Any]:
            text = inspect.cleandoc(schema.get("cls", cls).__doc__ or "").partition(">>>")[0].rstrip()
            return super().typed_dict_schema(schema) | {"additionalProperties": False, "description": text}

    found: dict[str, Any] = _tidied(Generate().generate(_Builder().whole(cls)))
    return {"$schema": Generate.schema_dialect, "title": f"whid {cls.__name__}"} | found


def _tidied(node: Any) -> Any:
    """Return the JSON Schema without unions of one, enums of one, and titles that repeat their key."""
    if isinstance(node, list):
        return [_tidied(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: _tidied(item) for key, item in node.items() if key != "title" or not isinstance(item, str)}
    if "const" in node:
        node.pop("enum", None)  # older pydantic writes both
    if len(node.get("oneOf", ())) == 1:
        (only,) = node.pop("oneOf")
        return only | node
    return node


def shape(value: Any) -> str:
    """Return what a YAML value is: nothing, flag, number, text, list or mapping."""
    if value is None or isinstance(value, bool):
        return "nothing" if value is None else "flag"
    known = {int: "number", float: "number", str: "text", list: "list", tuple: "list", dict: "mapping"}
    return next((name for kind, name in known.items() if isinstance(value, kind)), "other")


def keys(label: str) -> tuple[str, ...]:
    """Return the keys of a mapping by its label, "<module.Class>"."""
    module, _, name = label.strip("<>").rpartition(".")
    cls = getattr(sys.modules[module], name)
    return (*(("kind",) if issubclass(cls, Kind) else ()), *(yaml_key(f.name) for f in dataclasses.fields(cls)))


class _Builder:
    """Turns hints into core schemas; dataclasses and families become definitions, so that trees may be recursive."""

    def __init__(self) -> None:
        self.definitions: dict[str, CoreSchema | None] = {}

    def whole(self, cls: type) -> CoreSchema:
        top = self.schema(cls)
        return core_schema.definitions_schema(top, [d for d in self.definitions.values() if d is not None])

    def schema(self, hint: Any) -> CoreSchema:
        """Return the schema of a hint: a union by shape, of one alternative if need be."""
        if hint is Any:
            return core_schema.any_schema()
        labels: dict[str, str] = {}
        choices: dict[Any, CoreSchema] = {}
        for form, label, schema in self.alternatives(hint):
            if form in labels:
                raise TypeError(f"{hint}: two alternatives are {WORDS[form]}, a config could not tell which is meant")
            labels[form], choices[f"<{label}>"] = f"<{label}>", schema
        words = " or ".join(WORDS[form] for form in labels if form != "nothing")
        return core_schema.tagged_union_schema(
            choices, lambda value: labels.get(shape(value)), custom_error_type="shape", custom_error_message="{words}",
            custom_error_context={"words": words},
        )  # fmt: skip

    def alternatives(self, hint: Any) -> list[tuple[str, str, CoreSchema]]:
        """Return (shape, label, schema) of every alternative of a hint."""
        origin, arguments = get_origin(hint), get_args(hint)
        if origin in (Union, UnionType):
            return [found for argument in arguments for found in self.alternatives(argument)]
        if origin is Annotated:
            return [
                (form, label, _constrained(schema, arguments[1:])) for form, label, schema in self.alternatives(arguments[0])
            ]
        if origin is Literal:
            return [(shape(arguments[0]), shape(arguments[0]), core_schema.literal_schema(list(arguments)))]
        if origin in (tuple, list):
            return self.several(origin, arguments)
        if origin is dict:
            ((_, _, key),) = self.alternatives(arguments[0])
            return [("mapping", "mapping", core_schema.dict_schema(key, self.schema(arguments[1])))]
        if hint is complex:
            text = core_schema.no_info_after_validator_function(_complex, core_schema.str_schema())
            return [*self.alternatives(float), ("text", "text", text)]
        if hint in SCALARS:
            form, make = SCALARS[hint]
            schema = make()
            return [(form, form, core_schema.no_info_before_validator_function(_whole, schema) if hint is int else schema)]
        return [("mapping", *self.mapping(hint))]

    def several(self, origin: type, arguments: tuple[Any, ...]) -> list[tuple[str, str, CoreSchema]]:
        """Return a list's schema; a list of mappings may be written as one mapping."""
        if origin is list:
            return [("list", "list", core_schema.list_schema(self.schema(arguments[0])))]
        if len(arguments) != 2 or arguments[1] is not Ellipsis:
            return [("list", "list", core_schema.tuple_schema([self.schema(item) for item in arguments]))]
        many = ("list", "list", core_schema.tuple_schema([self.schema(arguments[0])], variadic_item_index=0))
        if not dataclasses.is_dataclass(arguments[0]):
            return [many]
        label, schema = self.mapping(arguments[0])
        return [many, ("mapping", label, core_schema.no_info_after_validator_function(lambda item: (item,), schema))]

    def mapping(self, cls: Any) -> tuple[str, CoreSchema]:
        """Return (label, reference) of a dataclass or of a family; its definition is made once."""
        label = f"{cls.__module__}.{cls.__qualname__}"
        ref = f"{label}:0"
        if ref not in self.definitions:
            self.definitions[ref] = None  # being made: a tree refers to itself
            made: Any = self.family(cls) if issubclass(cls, Kind) and not cls.kind else self.dataclass(cls)
            self.definitions[ref] = made | {"ref": ref}
        return label, core_schema.definition_reference_schema(ref)

    def family(self, base: type[Kind]) -> CoreSchema:
        """Return the union of a family's kinds, chosen by `kind:`, or by the one key that is a kind's own name."""
        kinds = {kind: cls for kind in base.kinds() if issubclass(cls := base.named(kind), base)}
        made = {kind: self.mapping(cls) for kind, cls in kinds.items()}
        short = {kind for kind, cls in kinds.items() if is_short(cls)}

        def pick(value: dict[str, Any]) -> str | None:
            named = {value["kind"]} if isinstance(value.get("kind"), str) else short & value.keys()
            return next((f"<{made[k][0]}>" for k in named if k in made), None) if len(named) == 1 else None

        return core_schema.tagged_union_schema(
            {f"<{label}>": schema for label, schema in made.values()}, pick, custom_error_type="kind",
            custom_error_message="{kinds}", custom_error_context={"kinds": " ".join(kinds), "family": base.family},
        )  # fmt: skip

    def dataclass(self, cls: Any) -> CoreSchema:
        """Return a mapping with the class' fields as keys, made into the class; its `WhidError` is a fault in place."""
        hints = get_type_hints(cls, include_extras=True)
        fields, names = {}, {}
        if issubclass(cls, Kind):
            fields["kind"] = core_schema.typed_dict_field(core_schema.literal_schema([cls.kind]), required=not is_short(cls))
        for field in dataclasses.fields(cls):
            schema, optional = self.schema(hints[field.name]), field.default is not dataclasses.MISSING
            if optional and isinstance(field.default, (bool, int, float, str)):
                schema = core_schema.with_default_schema(schema, default=field.default)
            names[yaml_key(field.name)] = field.name
            optional = optional or field.default_factory is not dataclasses.MISSING
            fields[yaml_key(field.name)] = core_schema.typed_dict_field(schema, required=not optional)

        def make(values: dict[str, Any]) -> Any:
            try:
                return cls(**{names[key]: value for key, value in values.items() if key in names})
            except WhidError as error:
                context = {"text": error.message, "code": error.code, "where": error.where}
                raise PydanticCustomError("whid", "{text}", context) from None

        whole = core_schema.typed_dict_schema(fields, cls=cls, extra_behavior="forbid")
        return core_schema.no_info_after_validator_function(make, whole)


def is_short(cls: Any) -> bool:
    """Tell whether a kind may be written without `kind:`, as `chain: [...]`: it has a field of its own name."""
    return any(field.name == cls.kind for field in dataclasses.fields(cls))


def _constrained(schema: Any, markers: tuple[Any, ...]) -> CoreSchema:
    """Return the schema with the bounds of `Annotated[...]`; markers of whid's own (`Free`) bound nothing here."""
    if schema["type"] == "function-before":  # a whole number
        return {**schema, "schema": _constrained(schema["schema"], markers)}
    if schema["type"] in ("function-after", "none", "literal"):  # one mapping in place of a list; not bounded
        return schema  # type: ignore[no-any-return]
    for marker in markers:
        if isinstance(marker, Match):
            schema = core_schema.custom_error_schema(
                schema | {"pattern": marker.pattern}, "text", custom_error_message="{words}",
                custom_error_context={"words": marker.words},
            )  # fmt: skip
        elif type(marker) in CONSTRAINTS:
            schema = schema | {CONSTRAINTS[type(marker)]: getattr(marker, CONSTRAINTS[type(marker)])}
        elif isinstance(marker, at.BaseMetadata | at.GroupedMetadata):
            raise TypeError(f"no rule for {marker}")
    return schema  # type: ignore[no-any-return]


def _whole(value: Any) -> Any:
    """Read 2e4 as the whole number it is."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _complex(text: str) -> complex:
    """Read -1+2j (or i)."""
    try:
        value = complex(text.replace(" ", "").replace("i", "j"))
    except ValueError:
        raise PydanticCustomError("complex", "must be a number such as -1+2j") from None
    if not abs(value) < float("inf"):
        raise PydanticCustomError("complex", "must be finite")
    return value
