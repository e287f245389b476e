"""Blocks, effects and methods of an installed package of the user's own: one file each, and nothing of whid changes."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

import whid
from whid import kinds
from whid.blocks._block import Block
from whid.cli import main
from whid.config import schema
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
METHOD = '''
from dataclasses import dataclass
from typing import Annotated, NamedTuple
import numpy as np
from whid.blocks.polynomial import Polynomial
from whid.experiments.hold import Hold
from whid.fit import linear_least_squares
from whid.methods._method import Answered, Method, Model, Wanted
from whid.quantity import Measured, Quantity, Table
from whid.system import System

class Chord(NamedTuple):
    """Chord: mean outputs of the holds."""
    level: Annotated[np.ndarray, Quantity("input", ("level",))]
    mean: Annotated[np.ndarray, Quantity("output", ("level",))]

    def table(self):
        return Table("Chord", ("level, input", "mean, output"), tuple(zip(self.level.tolist(), self.mean.tolist())))

    def metrics(self):
        return {"chord.levels": float(len(self.level))}

@dataclass(frozen=True, kw_only=True)
class StraightLine(Method):
    """A user's own method."""
    degree: int = 1

    def __call__(self, records, model=None):
        answer = yield Wanted((Hold(level=0.5, hold_s=2.0),), "one more level", 0.01, "the line, output")
        if answer is not None:
            yield Answered("a level")
        every = [*records, *([answer] if answer else [])]
        holds = [(r, p) for r in every for p in r.select("hold")]
        u = np.array([p.level for _, p in holds])
        y = np.array([r.y[p.start : p.stop].mean() for r, p in holds])
        yield Chord(u, y)
        names = tuple(f"chain.0.coefficients.{k}" for k in range(self.degree + 1))
        fit = linear_least_squares(np.vander(u, self.degree + 1, increasing=True), y, names=names)
        yield Model(System(chain=(Polynomial(coefficients=tuple(fit.values)),)), fit)
'''
STUDY = """
name: brought
plant: {chain: [{kind: polynomial, coefficients: [1, 2]}], noise: {kind: white, std: 0.01}}
experiment:
  dt: 0.1
  adaptive: {}
  parts: [{kind: staircase, from: -1, to: 1, step: 1, hold_s: 2}]
identify: {kind: straight_line}
expect: [{metric: chord.levels, above: 3.5}, {metric: nonlinearity.error.max, below: 0.02}]
"""
ENTRIES = """
[whid.blocks]
soft_gain = my_bench.soft_gain:SoftGain
[whid.effects]
softened = my_bench.softened:Softened
[whid.methods]
straight_line = my_bench.straight_line:StraightLine
"""


@pytest.fixture
def _installed(tmp_path, monkeypatch):
    package, info = tmp_path / "my_bench", tmp_path / "my_bench-1.2.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").write_text("")
    (package / "soft_gain.py").write_text(BLOCK)
    (package / "softened.py").write_text(EFFECT)
    (package / "straight_line.py").write_text(METHOD)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-bench\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(str(tmp_path))
    remembered = (kinds._brought, schema.validator)  # a process finds out once what is installed
    for what in remembered:
        what.cache_clear()
    yield
    for what in remembered:
        what.cache_clear()


@pytest.mark.usefixtures("_installed")
def test_an_installed_package_brings_a_block_and_an_effect():
    block = Block.named("soft_gain")
    assert block.package() == "my-bench 1.2"
    assert Block.named("saturation").package() == ""
    assert block(coefficients=(0.0, 2.0))([1.0], 1.0)[0] == 2.0
    assert "softened@input" in [effect.name for effect in Trace().every()]
    assert Effect.named("softened").package() == "my-bench 1.2"


@pytest.mark.usefixtures("_installed")
def test_a_method_is_one_file(tmp_path, monkeypatch):
    """It is offered, checked, run, served with experiments, printed, stored, read back and shown."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))

    def call(*arguments):
        done = CliRunner().invoke(main, list(arguments))
        assert done.exit_code == 0, done.output
        return done.stdout

    (tmp_path / "study.yaml").write_text(STUDY)
    assert "straight_line" in call("kinds", "methods")
    assert "A user's own method" in call("kinds", "straight_line")
    assert "straight_line" in json.dumps(json.loads(call("schema")))
    call("check", "study.yaml")
    printed = call("run", "study.yaml")
    for text in ("Chord", "one more level", "a level", "chord.levels", "pass"):
        assert text in printed
    (folder,) = (tmp_path / "runs").iterdir()
    again = whid.load(folder)
    assert again.stages["chord"].level.tolist() == [-1.0, 0.0, 1.0, 0.5]
    assert again.model.estimate.values == pytest.approx([1.0, 2.0], abs=0.02)
    call("run", "study.yaml", "--set", "identify.degree=2")
    call("show", str(folder))
