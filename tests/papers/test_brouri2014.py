"""The exhibits of the second paper: what (28a) gives, what the stretch of a curve gives, the late borders, the pictures."""

from pathlib import Path

import numpy as np
import pytest

from tests.brouri2014 import normalised, plant, response
from whid.config.load import load_study
from whid.papers._brouri2014 import STEP, crossing_rate, progressive, shoot, stretch
from whid.regenerate import bench_of, regenerate

CONFIGS = Path(__file__).parents[2] / "configs" / "brouri2014"
PIECES = {"A1": ((0.57, 1.63, 1.0), (-2.03, -0.61, 2 / 3), (1.63, 2.34, 0.4)),
          "A2": ((0.53, 1.46, 1.0), (1.46, 2.37, -0.5))}  # fmt: skip


@pytest.mark.parametrize("which", ["A1", "A2"])
def test_the_configs_are_the_plants_in_the_scaling_of_the_model(which):
    study = load_study(CONFIGS / f"{which.lower()}.yaml")
    u, ours = np.linspace(-3, 3, 301), normalised(which)
    assert study.plant.chain[0].value(u) == pytest.approx(ours.chain[0].value(u), abs=1e-9)
    x = study.plant.chain[0].value(u) * plant(which, 0.1).chain[0].pieces[3][1]
    true = plant(which, 0.1).chain[-1].value(x * response(which, 0.0).real)
    assert study.plant.chain[-1].value(study.plant.chain[0].value(u)) == pytest.approx(true, abs=1e-9)


@pytest.mark.parametrize("which", ["A1", "A2"])
def test_slopes_are_in_the_stretch_and_not_in_the_crossings(which):
    """(28a) as printed gives 1 on every piece; least squares of the stretch gives the slope, its sign from the phase."""
    (low, high, _), *others = PIECES[which]
    system, rng = normalised(which), np.random.default_rng(0)
    own = crossing_rate(system, low, high, 1.0, 3)
    anchor = shoot(system, (low + high) / 2, 0.4 * (high - low), 1.0, 3, rng)
    for a, b, slope in others:
        assert crossing_rate(system, a, b, 1.0, 3) / own == pytest.approx(1.0, abs=0.02)
        other = shoot(system, (a + b) / 2, 0.4 * (b - a), 1.0, 3, rng)
        assert stretch(anchor, other).value == pytest.approx(slope, abs=0.01)


@pytest.mark.slow
def test_the_progressive_search_finds_borders_late():
    segments, count = progressive(plant("A1", 0.05), -3.0, 3.0, 1.0, 3, np.random.default_rng(1))
    late = np.array([s.end for s in segments[:-1]]) - (-2.03, -0.61, 0.57, 1.63, 2.34)
    print(f"{count} experiments, borders late by {late.round(3)}")
    assert 140 <= count <= 155
    assert (late > -STEP).all()
    assert late.max() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a1", "a2"])
def test_tables_are_as_expected(name, tmp_path):
    found = regenerate(CONFIGS / f"{name}.yaml", tmp_path, check=True)
    print(found.drift, found.bars)
    assert found.exit_code == 0


def test_pictures(tmp_path):
    from whid.plots._style import save

    study = load_study(CONFIGS / "a1.yaml")
    exhibits = [one for one in study.table if one.kind != "brouri2014_tables"]
    assert len(exhibits) == 2
    for one in exhibits:
        bench = bench_of(study, CONFIGS, one, False, lambda *_: None)
        found = one(bench)
        save(lambda run, figure, draw=found.draw: draw(figure), None, tmp_path / f"{one.kind}.png")
        assert (tmp_path / f"{one.kind}.png").stat().st_size > 20_000
        for row in found.rows:
            cell = row.efficient or row.paper
            if hasattr(cell, "std") and "RMSE" not in row.quantity:
                assert abs(cell.value - row.bound) < 4.5 * cell.std, row
