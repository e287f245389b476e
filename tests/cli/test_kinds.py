import json

import pytest

from whid.blocks._block import Block
from whid.cli.kinds import words


def test_every_kind_has_a_line(whid):
    rows = json.loads(whid("kinds", "--json").stdout)[0]["rows"]
    families = {"blocks", "disturbances", "experiments", "operations", "methods", "effects", "papers"}
    assert {row["family"] for row in rows} == families
    assert [row["kind"] for row in rows if row["family"] == "blocks"] == list(Block.kinds())
    assert all(row["what it is"] for row in rows)


def test_a_family(whid):
    rows = json.loads(whid("kinds", "disturbances", "--json").stdout)[0]["rows"]
    assert {row["family"] for row in rows} == {"disturbances"}


def test_a_kind_with_its_equation_and_its_keys(whid):
    found = whid("kinds", "dead_zone")
    assert "w = slope·(v − high) for v > high" in found.stdout
    assert ">>>" not in found.stdout
    rows = json.loads(whid("kinds", "dead_zone", "--json").stdout)[0]["rows"]
    assert rows[-2:] == [
        {"key": "slope", "value": "number", "default": "1.0"},
        {"key": "knee", "value": "number", "default": ""},
    ]
    assert {"key": "low", "value": "number", "default": "required"} in rows


def test_one_that_is_not_there(whid):
    found = whid("kinds", "ded_zone")
    assert found.exit_code == 2
    assert "no kind or family 'ded_zone', did you mean dead_zone?" in found.stderr


@pytest.mark.parametrize(
    ("schema", "said"),
    [
        ({"enum": ["zoh", "foh"]}, "zoh | foh"),
        ({"const": "chain"}, "chain"),
        ({"type": "integer", "minimum": 1, "maximum": 5}, "whole number >= 1 <= 5"),
        ({"oneOf": [{"type": "number"}, {"type": "null"}]}, "number"),
        ({"oneOf": [{"type": "array", "items": {"$ref": "#/$defs/Block"}}, {"$ref": "#/$defs/Block"}]}, "list of Block"),
        ({"type": "array", "prefixItems": [{"type": "integer"}, {"type": "string"}]}, "list of whole number, text"),
        ({}, "anything"),
    ],
)
def test_words(schema, said):
    assert words(schema) == said
