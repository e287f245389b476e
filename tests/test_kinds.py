"""The folder is the registry."""

import subprocess
import sys
from pathlib import Path

import pytest

import whid.blocks
from whid.blocks._block import Block
from whid.blocks.dead_zone import DeadZone
from whid.disturbances._disturbance import Disturbance
from whid.errors import WhidError
from whid.experiments._part import Part
from whid.kinds import plain, yaml_key
from whid.methods._method import Method
from whid.papers._exhibit import Exhibit


@pytest.mark.parametrize("family", [Block, Part, Disturbance, Method, Exhibit])
def test_kinds_are_the_files_of_the_folder(family):
    folder = Path(whid.blocks.__file__).parents[1] / family.family.partition(".")[2]
    assert set(family.kinds()) == {p.stem for p in folder.glob("*.py") if not p.stem.startswith("_")}


@pytest.mark.parametrize("family", [Block, Part, Disturbance, Method, Exhibit])
def test_every_kind_is_found_by_its_name(family):
    for kind in family.kinds():
        found = family.named(kind)
        assert found.kind == kind
        assert issubclass(found, family)
        assert found.summary()


def test_listing_imports_no_kind():
    code = "import sys; from whid.blocks._block import Block; Block.kinds(); print('whid.blocks.linear' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "False"


def test_an_unknown_kind_names_the_nearest():
    with pytest.raises(WhidError, match="did you mean dead_zone") as fault:
        Block.named("deadzone")
    assert fault.value.code == "config-kind"
    with pytest.raises(WhidError):
        Block.named("_block")


def test_plain_leaves_defaults_out():
    assert plain({"a": (DeadZone(low=-1.0, high=1.0), 2)}) == {"a": [{"kind": "dead_zone", "low": -1.0, "high": 1.0}, 2]}
    assert yaml_key("from_") == "from"
