"""The schema that editors get says the same as the check that whid does."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Literal

import annotated_types as at
import pytest
from pydantic_core import ValidationError

from whid.blocks._block import Block
from whid.config.schema import _Builder, json_schema, validator
from whid.config.study import Study
from whid.disturbances._disturbance import Disturbance
from whid.experiments._part import Part
from whid.kinds import yaml_key
from whid.methods._method import Method
from whid.operations._operation import Operation
from whid.papers._exhibit import Exhibit

FAMILIES = (Block, Disturbance, Part, Operation, Method, Exhibit)
KINDS = [base.named(kind) for base in FAMILIES for kind in base.kinds()]


@pytest.mark.parametrize("cls", KINDS, ids=lambda cls: f"{cls.family}.{cls.kind}")
def test_every_kind_has_its_kind_and_its_keys_and_no_others(cls):
    whole = json_schema(cls)
    found = whole["$defs"][whole["$ref"].rpartition("/")[2]] if "$ref" in whole else whole
    assert found["properties"]["kind"] == {"const": cls.kind, "type": "string"}
    assert set(found["properties"]) == {"kind", *(yaml_key(field.name) for field in dataclasses.fields(cls))}
    assert found["additionalProperties"] is False
    assert found["description"].startswith(cls.summary())


def test_every_kind_of_every_family_is_in_the_schema_of_a_study():
    kinds = [d["properties"]["kind"] for d in json_schema()["$defs"].values() if "kind" in d.get("properties", {})]
    consts = {kind["const"] for kind in kinds if "enum" not in kind}  # an option may have a choice called kind, too
    assert consts == {cls.kind for cls in KINDS}


def test_trees_refer_to_themselves():
    schema = json_schema()
    assert {"$ref": "#/$defs/Chain"} in schema["$defs"]["Block"]["oneOf"]
    assert schema["$schema"].startswith("https://json-schema.org/")


@dataclass(frozen=True, kw_only=True)
class Example:
    """All the hints that fields may have."""

    size: Annotated[float, at.Gt(0), at.Lt(10)]
    count: Annotated[int, at.Ge(1), at.Le(5)] = 1
    many: Annotated[tuple[Annotated[float, at.Gt(0)], ...], at.MinLen(2), at.MaxLen(3)] | float | None = None
    pair: tuple[int, str] = (1, "a")
    mode: Literal["a", "b"] = "a"
    flag: bool = False
    root: complex = 0j
    names: dict[Literal["input", "output"], str] | None = None


CHECK = validator(Example)


@pytest.mark.parametrize(
    "good",
    [
        {"size": 1}, {"size": 9.5, "count": 5.0}, {"size": 1, "many": [1, 2]}, {"size": 1, "many": -3},
        {"size": 1, "many": None}, {"size": 1, "pair": [2, "x"]}, {"size": 1, "root": "1 - 2j"}, {"size": 1, "root": 3},
        {"size": 1, "names": {"input": "V"}}, {"size": 1, "flag": True, "mode": "b"},
    ],
)  # fmt: skip
def test_what_is_allowed(good):
    assert isinstance(CHECK.validate_python(good), Example)


@pytest.mark.parametrize(
    "bad",
    [
        {}, {"size": 0}, {"size": 10}, {"size": True}, {"size": "1"}, {"size": float("nan")}, {"size": None},
        {"size": 1, "count": 0}, {"size": 1, "count": 6}, {"size": 1, "count": 1.5}, {"size": 1, "count": "1"},
        {"size": 1, "count": False}, {"size": 1, "many": [1]}, {"size": 1, "many": [1, 2, 3, 4]},
        {"size": 1, "many": [1, -1]}, {"size": 1, "many": "1"}, {"size": 1, "pair": [1]}, {"size": 1, "pair": [1, 2]},
        {"size": 1, "mode": "c"}, {"size": 1, "flag": 1}, {"size": 1, "flag": "yes"}, {"size": 1, "root": "x"},
        {"size": 1, "root": "nan"}, {"size": 1, "names": {"time": "s"}}, {"size": 1, "extra": 1}, [], "x", 3, None,
    ],
)  # fmt: skip
def test_what_is_not_allowed(bad):
    with pytest.raises(ValidationError):
        CHECK.validate_python(bad)


def test_a_hint_that_a_config_could_not_tell_apart_is_refused():
    with pytest.raises(TypeError, match="could not tell"):
        _Builder().schema(float | int)
    with pytest.raises(TypeError, match="no rule"):
        _Builder().schema(Annotated[float, at.MultipleOf(2)])


def test_the_validator_is_made_once():
    assert validator(Study) is validator(Study)
