"""Table 1 and Figures 2, 3, 5 of [Jeraj and Mathews] as `whid table` makes them, at reduced counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from whid.config.load import load_study
from whid.papers._jeraj import trials
from whid.regenerate import bench_of

CONFIGS = Path(__file__).parents[2] / "configs" / "jeraj"


def made(config, kind, runs=None, full=False):
    study = load_study(CONFIGS / config)
    exhibit = next(one for one in study.table if one.kind == kind)
    exhibit = replace(exhibit, runs=runs, full_runs=exhibit.full_runs) if runs else exhibit
    return exhibit(bench_of(study, CONFIGS, exhibit, full, lambda *_: None))


def drawn(found, tmp_path):
    from whid.plots._style import save

    save(lambda _, figure: found.draw(figure), None, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def breached(found):
    return [bar for bar in found.bars if bar.verdict != "pass"]


def test_table_1(tmp_path):
    found = made("table-1.yaml", "jeraj_table_1", 50)
    assert breached(found) == []
    assert len(found.rows) == 16
    rows = {row.quantity: row for row in found.rows}
    assert (rows["C1"].published, rows["C1"].bound) == (pytest.approx(0.83977374137880), pytest.approx(0.8399875))
    assert rows["variance of C6, 1e-6"].published == 5.15691189
    assert rows["variance of C6, 1e-6"].efficient.value < 0.1 * rows["variance of C6, 1e-6"].paper.value
    drawn(found, tmp_path)


def test_figure_2(tmp_path):
    found = made("table-1.yaml", "jeraj_figure_2", 12)
    assert len(found.rows) == 36
    assert [bar.metric for bar in breached(found) if bar.metric.startswith("B3")] == []
    rows = {row.quantity: row for row in found.rows}
    paper = [rows[f"mean, {snr}"].paper.value for snr in ("0 dB", "20 dB", "40 dB", "no noise")]
    assert paper[0] > 5 * paper[1] > 15 * paper[2]
    assert rows["mean, no noise"].efficient == "rounding"
    drawn(found, tmp_path)


def test_figures_3_and_5(tmp_path):
    found = made("table-1.yaml", "jeraj_figure_3", 3)
    assert found.rows[0].efficient == "rounding"
    assert found.rows[1].efficient.value < found.rows[1].paper.value
    drawn(found, tmp_path)
    found = made("equaliser.yaml", "jeraj_figure_5", 3)
    assert found.rows[0].efficient.value < found.rows[0].paper.value - 12
    drawn(found, tmp_path)


def test_the_noise_has_the_size_that_is_said():
    study = load_study(CONFIGS / "table-1.yaml")
    bench = bench_of(study, CONFIGS, study.table[0], False, lambda *_: None)
    (trial,) = trials(bench, 1, 20.0, 9)
    w = 0.5733 * trial.x + 0.4267 * trial.x**5
    assert trial.noise_std == pytest.approx(0.1 * w.std(), rel=1e-9)
    assert np.std(trial.y - w) == pytest.approx(trial.noise_std, rel=5 / np.sqrt(2 * len(w)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "kind"),
    [
        ("table-1.yaml", "jeraj_table_1"),
        ("table-1.yaml", "jeraj_figure_2"),
        ("table-1.yaml", "jeraj_figure_3"),
        ("equaliser.yaml", "jeraj_figure_5"),
    ],
)
def test_full(config, kind):
    found = made(config, kind, full=True)
    for bar in found.bars:
        print(f"{bar.metric}: {bar.value:.4g} ({bar.verdict})")
    assert breached(found) == []
