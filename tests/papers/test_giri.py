"""Figures 1-3 redrawn, the simulations that Giri et al. left out, and the plant that never moves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.giri import B2, g1, period
from whid.config.load import load_study
from whid.papers._giri import Numbers, seen
from whid.regenerate import bench_of

CONFIGS = Path(__file__).parents[2] / "configs" / "giri"


def bench(config, kind, every=1, **changes):
    """The exhibit of a config and its bench, with every so many of the study's experiments."""
    study = load_study(CONFIGS / f"{config}.yaml")
    exhibit = replace(next(one for one in study.table if one.kind == kind), **changes)
    study = replace(study, experiment=study.experiment[::every])
    return exhibit, bench_of(study, CONFIGS, exhibit, False, lambda *_: None)


def drawn(found, folder):
    from whid.plots._style import save

    save(lambda _, figure: found.draw(figure), None, folder / "picture.png")
    assert (folder / "picture.png").stat().st_size > 20_000


def near(row, column="efficient"):
    cell = getattr(row, column)
    assert abs(cell.value - row.bound) < 4.5 * cell.std, row


def test_figure_1_has_the_crossing_and_the_turning_points_of_the_borders(tmp_path):
    exhibit, one = bench("b2", "giri_figure_1", every=2)
    found = exhibit(one)
    rising, falling = (np.polynomial.Polynomial(side) for side in B2)
    assert len(found.rows) == 2 * 4  # one crossing, two turning points of a cubic, one of the other's within reach
    for x, w in zip(found.rows[::2], found.rows[1::2], strict=True):
        near(x)
        near(w)
        zero = rising - falling if "cross" in x.quantity else (rising if "rising" in x.quantity else falling).deriv()
        assert abs(zero(x.bound)) < 1e-9
    drawn(found, tmp_path)


def test_figure_2_shows_the_stages_and_that_they_seem_to_begin_early(tmp_path):
    exhibit, one = bench("b2", "giri_figure_2")
    read, separable, top, bottom = exhibit(one).rows
    for row in (read, top, bottom):
        near(row)
    near(separable, "paper")
    assert read.paper.value - read.bound > 0.05
    assert top.paper.value - top.bound > 0.05
    w = period(B2, 1.0, 1.0, samples=4096)  # the truth's stages, by the rule sample by sample
    still = np.abs(np.diff(w, append=w[0])) < 1e-12
    assert still.sum() * 2 * np.pi / 4096 == pytest.approx(top.bound + bottom.bound, abs=0.006)
    drawn(exhibit(one), tmp_path)


def test_figure_3_recovers_both_borders_where_nothing_stands_still(tmp_path):
    exhibit, one = bench("b5", "giri_figure_3")
    found = exhibit(one)
    *numbers, stage, verdict = found.rows
    assert len(numbers) == 9
    for row in numbers:
        near(row)
        near(row, "paper")
    assert stage.bound < 0.06 < stage.paper
    assert verdict.efficient == verdict.bound == "backlash"
    assert [bar.verdict for bar in found.bars] == ["pass"]
    drawn(found, tmp_path)


def test_what_is_seen_is_the_truth_and_either_branch_is_taken_to_the_same():
    _, one = bench("b2", "giri_figure_2")
    found = seen(one, 4, 1)
    assert found.truth.phase == pytest.approx(np.angle(g1(1.0)), abs=1e-9)
    np.testing.assert_allclose(found.truth.rising, B2[0] * found.size ** np.arange(4))
    mirrored = Numbers(found.truth.phase + np.pi, *(found.truth.near(found.truth.phase + np.pi))[1:])
    for a, b in zip(mirrored.near(found.truth.phase), found.truth, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_the_efficient_estimate_is_as_good_as_it_claims_and_better_than_the_papers(tmp_path):
    exhibit, one = bench("b2", "giri_simulations", every=2, snr_db=(40.0,), runs=1)
    found = exhibit(one)
    phases, gains, told = found.rows
    for row in (phases, gains):
        assert row.efficient.value < 2 * row.bound.value  # 6 or 5 numbers: beyond 2 with chance 1e-3 if it claims the truth
        assert row.efficient.value < row.paper.value / 5
    assert told.efficient.value == 1
    assert [bar.verdict for bar in found.bars] == ["pass"]
    drawn(found, tmp_path)


def test_a_static_curve_is_told_from_the_same_exhibit():
    exhibit, one = bench("b3", "giri_simulations", every=2, snr_db=(40.0,), runs=1)
    *_, told = exhibit(one).rows
    assert "static" in told.quantity
    assert told.efficient.value == 1


def test_a_plant_that_sticks_is_refused_at_any_amplitude():
    exhibit, one = bench("b4", "giri_never_moves", every=6, runs=1, factors=(1.0, 16.0))
    found = exhibit(one)
    assert [row.efficient.value for row in found.rows] == [0, 1, 0, 1]
    assert {bar.verdict for bar in found.bars} == {"pass"}
    assert not any("failed" in note for note in found.notes)
