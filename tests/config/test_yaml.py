import contextlib
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whid.config.yaml import ALIASED, DEPTH, dump, parse, spelled
from whid.errors import Faults


def fault(text):
    with pytest.raises(Faults) as caught:
        parse(text, "f.yaml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        # YAML 1.2.2, section 10.3.2, tests of the core schema
        ("1e-3", 1e-3), ("1E3", 1000.0), ("+1.", 1.0), (".5", 0.5), ("-2.e+1", -20.0), ("12", 12), ("-7", -7),
        ("010", 10), ("0o17", 15), ("0x1F", 31), (".inf", math.inf), ("-.INF", -math.inf), ("~", None), ("null", None),
        ("true", True), ("FALSE", False),
        # what PyYAML alone reads otherwise
        ("no", "no"), ("yes", "yes"), ("on", "on"), ("Off", "Off"), ("1_000", "1_000"), ("12:30:45", "12:30:45"),
        ("2019-01-01", "2019-01-01"), ("0b1", "0b1"), ("'1'", "1"), ('"no"', "no"), ("1e", "1e"), (".", "."), ("-", [None]),
    ],
)  # fmt: skip
def test_scalars_are_those_of_yaml_1_2(text, value):
    found = parse(text).value
    assert found == value
    assert type(found) is type(value)


def test_nan_is_a_float():
    assert math.isnan(parse(".NaN").value)


def test_places_of_values_and_keys():
    document = parse("plant:\n  chain:\n    - {kind: linear, num: [1, 2]}\n", "f.yaml")
    assert document.where(("plant", "chain", 0, "num", 1)) == "f.yaml:3:31: plant.chain[0].num[1]"
    assert document.where(("plant", "chain", 0, "num"), key=True) == "f.yaml:3:22: plant.chain[0].num"
    assert document.where(("plant", "chain", 0, "den")) == "f.yaml:3:7: plant.chain[0].den"  # absent: what should hold it


def test_spelled():
    assert spelled(("plant", "chain", 1, "pieces", 0, 2)) == "plant.chain[1].pieces[0][2]"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: 2\na: 3", "f.yaml:3:1: a: the key stands twice, first in line 1"),
        ("x: {a: 1, a: 2}", "f.yaml:1:11: x.a: the key stands twice"),
        ("a: !!python/object/apply:os.system [ls]", "f.yaml:1:4: a: tags"),
        ("a: !!str 1", "tags"),
        ("!thing a: 1", "tags"),
        ("a: 1\n---\nb: 2", "f.yaml:2:1: a second document"),
        ("a: [1, 2", "f.yaml:1:9: not YAML"),
        ("a:\n\tb: 1", "f.yaml:2:1: a tab"),
        ("a: \x07", "f.yaml:1:4: the character U+0007"),
        ("1: 2", "a key must be a name, not '1'"),
        ("true: 2", "a key must be a name, not 'true'"),
        ("[a]: 2", "a key must be a name"),
        ("a: *b", "undefined alias"),
        ("a: &a [*a]", "contains itself"),
        ("a: &a {b: {<<: *a}}", "contains itself"),
        ("a: {<<: 3}", "merges mappings only"),
        ('a: "\\ud800"', "surrogate"),
        ('a: "\\UFFFFFFFF"', "cannot hold"),
        ("[" * (DEPTH + 5), f"nested deeper than {DEPTH}"),
    ],
)
def test_faults_have_their_place(text, said):
    assert said in fault(text)


def test_all_faults_at_once():
    assert len(fault("a: 1\na: 2\nb: !x 3\n4: 5").splitlines()) == 3


def test_anchors_and_merges_within_bounds():
    text = "base: &b {x: 1, y: 2}\none: {<<: *b, y: 3}\ntwo: {y: 4, <<: [*b, {z: 5, x: 6}]}\nthree: *b"
    value = parse(text).value
    assert value["one"] == {"x": 1, "y": 3}
    assert value["two"] == {"x": 1, "y": 4, "z": 5}
    assert value["three"] == {"x": 1, "y": 2}


def test_anchor_bomb():
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"] + [
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)
    ]
    assert f"more than {ALIASED} values" in fault("\n".join(rows))


@settings(max_examples=200, deadline=None)
@given(st.text())
def test_any_text_is_a_value_or_a_fault(text):
    with contextlib.suppress(Faults):
        parse(text)


FRAGMENTS = st.sampled_from(
    [*"abz019.-+e:,[]{}&*!|>%@`'\"#?~ \n\t\\", "- ", ": ", "<<: ", "&a ", "*a", "---\n", "...", "%YAML", "\\u"]
)


@settings(max_examples=200, deadline=None)
@given(st.lists(FRAGMENTS, max_size=40).map("".join))
def test_any_yaml_like_text_is_a_value_or_a_fault(text):
    with contextlib.suppress(Faults):
        parse(text)


TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"], exclude_characters="\ufffe\uffff"))
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**30), 10**30) | st.floats(allow_nan=False) | TEXT
    | st.sampled_from(["no", "1e3", "010", "<<", "=", "~", "", "1_0", "0x1", "2019-01-01", " a", "a ", "- b", "k: v", "#"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=12,
)  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(VALUES)
def test_dump_is_read_back_as_it_was(value):
    assert parse(dump(value)).value == value
