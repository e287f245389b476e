"""The calibration sweep: balanced, resumable, honest about what it counts; and the bars T1 to T6 at their own counts."""

import csv
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from tests.closed_loop import calibrate
from tests.closed_loop.calibrate import Calibration, Cell, Row, report, run, sweep
from tests.closed_loop.hidden import EFFECTS

CONFIG = Path(__file__).parents[2] / "configs" / "closed_loop" / "calibration.yaml"
ROW = Row("k", "one", "hum@output", 0.5, 1, "linear", False, False, "right", "hum@output", 1.0, 2.0)


def answering(*effects, verdict="explained"):
    named = [dict(zip(("kind", "place"), e.split("@"), strict=True)) for e in effects]
    return {"verdict": verdict, "effects": named, "equivalent": [], "after": {"rms": 1.0}, "seconds": 1.0}


def test_the_shipped_file_has_the_bars_counts():
    cells = Calibration.read(CONFIG).cells()
    groups = Counter(cell.group for cell in cells)
    assert groups["control"] >= 200
    assert groups["one"] == 3 * 10 * len(EFFECTS) >= 3 * 300
    assert len({cell.key for cell in cells}) == len(cells)
    assert min(cell.seed for cell in cells) >= 50_000
    half = Counter(cell.group for cell in cells[: len(cells) // 2])
    assert all(abs(half[group] - n / 2) <= 1 for group, n in groups.items())


def test_no_plant_of_an_effect_is_drawn_twice():
    one = [cell for cell in Calibration.read(CONFIG).cells() if cell.group == "one"]
    seeds = {(cell.effects, cell.seed) for cell in one}
    assert len({seed for _, seed in seeds}) == len(seeds)


def test_an_unknown_key_or_effect_is_refused():
    with pytest.raises(SystemExit, match="no such key: plant"):
        Calibration.read(CONFIG, ["plant=3"])
    with pytest.raises(SystemExit, match="no such effect: humm@output"):
        Calibration.read(CONFIG, ["effects=[humm@output]"])


def test_a_cell_is_drawn_traced_and_scored_without_the_truth_in_reach(monkeypatch):
    seen = []

    def look(study, out):
        seen.extend(file.name for file in study.parent.iterdir())
        assert "offset_step" not in study.read_text()
        return answering("offset_step@output"), ""

    monkeypatch.setattr(calibrate, "traced", look)
    row = run(Cell("one", ("offset_step@output",), 0.5, 200, False))
    assert (row.outcome, row.said, row.hidden) == ("right", "offset_step@output", "offset_step@output")
    assert sorted(seen) == ["case-200.npz", "case-200.yaml"]


def test_a_run_without_an_answer_is_a_failure_with_its_reason(monkeypatch):
    monkeypatch.setattr(calibrate, "traced", lambda study, out: (None, "exit 2: no such thing"))
    row = run(Cell("control", (), 0.0, 210, False))
    assert (row.outcome, row.note) == ("failed", "exit 2: no such thing")


def test_a_sweep_goes_on_where_it_stopped(tmp_path, monkeypatch):
    done = []

    def fake(cell):
        done.append(cell)
        if len(done) == 4:
            raise KeyboardInterrupt
        return replace(ROW, key=cell.key, seed=cell.seed)

    monkeypatch.setattr(calibrate, "run", fake)
    cells = [Cell("one", ("hum@output",), 0.5, seed, False) for seed in range(6)]
    with pytest.raises(KeyboardInterrupt):
        sweep(cells, tmp_path / "log")
    with (tmp_path / "log").open("a") as file:
        file.write('{"key": "cut off in the mid')
    rows = sweep(cells, tmp_path / "log2", minutes=-1)
    assert rows == []
    (tmp_path / "log").write_text((tmp_path / "log").read_text() + "\n")
    assert [row.seed for row in sweep(cells, tmp_path / "log")] == list(range(6))
    assert len(done) == 7


def test_the_page_counts_what_it_says(tmp_path):
    rows = [ROW, replace(ROW, outcome="wrong", said="lag@front"), replace(ROW, outcome="not visible"),
            replace(ROW, group="control", hidden="", size=0.0, outcome="right", said="nothing missing"),
            replace(ROW, group="outside", hidden="bouc_wen@outside", outcome="right", said="unattributed")]  # fmt: skip
    text = report(rows, tmp_path, "test")
    assert "False alarms on records with nothing hidden: 0/1 = 0.0 % [0.0, 97.5]" in text
    assert "| 0.5 | 1 | 0 | 1 | 0 | 0 | 0 | 1/2 = 50.0 % [1.3, 98.7] |" in text
    assert "| hum@output | 0.5 | lag@front | wrong | 1 |" in text
    assert "1 cells left out" in text
    with (tmp_path / "cells.csv").open() as file:
        assert [row["outcome"] for row in csv.DictReader(file)] == [row.outcome for row in rows]
    assert (tmp_path / "confusion.png").stat().st_size > 10_000
