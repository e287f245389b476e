"""Blocks and effects of an installed package of the user's own."""

from __future__ import annotations

import pytest

from whid import kinds
from whid.blocks._block import Block
from whid.effects._effect import Effect
from whid.trace import Trace

BLOCK = '''
from dataclasses import dataclass
from whid.blocks.polynomial import Polynomial

@dataclass(frozen=True, kw_only=True)
class SoftGain(Polynomial):
    """A user's own curve."""
'''
EFFECT = '''
from dataclasses import dataclass
from whid.effects._effect import Effect
from my_bench.soft_gain import SoftGain

@dataclass(frozen=True, kw_only=True)
class Softened(Effect):
    """A user's own effect."""
    places = ("input",)

    def candidates(self, look, sites):
        block = SoftGain(coefficients=(0.0, 1.0, 0.0), fix=("coefficients.0", "coefficients.1"))
        yield sites.inserted(0, block).candidate("coefficients.2", amplitude=("coefficients.2",))
'''
ENTRIES = """
[whid.blocks]
soft_gain = my_bench.soft_gain:SoftGain
[whid.effects]
softened = my_bench.softened:Softened
"""


@pytest.fixture
def _installed(tmp_path, monkeypatch):
    package, info = tmp_path / "my_bench", tmp_path / "my_bench-1.2.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").write_text("")
    (package / "soft_gain.py").write_text(BLOCK)
    (package / "softened.py").write_text(EFFECT)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-bench\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(str(tmp_path))
    kinds._brought.cache_clear()
    yield
    kinds._brought.cache_clear()


@pytest.mark.usefixtures("_installed")
def test_an_installed_package_brings_a_block_and_an_effect():
    block = Block.named("soft_gain")
    assert block.package() == "my-bench 1.2"
    assert Block.named("saturation").package() == ""
    assert block(coefficients=(0.0, 2.0))([1.0], 1.0)[0] == 2.0
    assert "softened@input" in [effect.name for effect in Trace().every()]
    assert Effect.named("softened").package() == "my-bench 1.2"
