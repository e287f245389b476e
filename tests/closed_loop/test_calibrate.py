"""The calibration sweep: balanced, resumable, honest about what it counts; and the bars T1 to T6 at their own counts."""

import csv
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.closed_loop import calibrate
from tests.closed_loop.calibrate import Calibration, Cell, Row, report, run, sweep
from tests.closed_loop.hidden import EFFECTS
from tests.closed_loop.score import interval

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

    def look(study):
        seen.extend(file.name for file in study.parent.iterdir())
        assert "offset_step" not in study.read_text()
        return answering("offset_step@output"), ""

    monkeypatch.setattr(calibrate, "traced", look)
    row = run(Cell("one", ("offset_step@output",), 0.5, 200, False))
    assert (row.outcome, row.said, row.hidden) == ("right", "offset_step@output", "offset_step@output")
    assert sorted(seen) == ["case-200.npz", "case-200.yaml"]


def test_a_run_without_an_answer_is_a_failure_with_its_reason(monkeypatch):
    monkeypatch.setattr(calibrate, "traced", lambda study: (None, "no-such-thing: there is none"))
    row = run(Cell("control", (), 0.0, 210, False))
    assert (row.outcome, row.note) == ("failed", "no-such-thing: there is none")


def test_a_cell_that_does_not_end_abstains_and_the_sweep_goes_on(tmp_path, monkeypatch):
    def hang(study):
        while True:
            try:
                sum(range(1000))
            except Exception:  # the flow takes any Exception for a fault of its own
                continue

    monkeypatch.setattr(calibrate, "traced", hang)
    cells = [Cell("control", (), 0.0, seed, False, 0.1) for seed in (230, 240)]
    rows = sweep(cells, tmp_path / "log")
    assert [(row.outcome, row.said) for row in rows] == [("abstained", "timed out")] * 2
    assert all(0.1 <= row.seconds < 1 for row in rows)


def test_a_fault_of_the_harness_is_a_failed_cell(monkeypatch):
    monkeypatch.setattr(calibrate, "draw_case", lambda *a, **k: 1 / 0)
    (row,) = calibrate.work(None, [Cell("one", ("hum@output",), 0.5, 220, False)])
    assert (row.outcome, row.hidden, row.note) == ("failed", "hum@output", "ZeroDivisionError: division by zero")


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


@pytest.fixture(scope="module")
def calibrated():
    """The shipped calibration, whole; what is done already in runs/ is not done again."""
    import json

    folder = calibrate.main([str(CONFIG), "--out", str(CONFIG.parents[2] / "runs")])
    rows = [Row(**json.loads(line)) for line in (folder / "cells.jsonl").read_text().splitlines()]
    return [row for row in rows if row.outcome != "not visible"]


def reaches(hits, of, share):
    """Whether a share is reached, as far as so many trials can tell: the upper end of its 95 % interval is."""
    low, high = interval(hits, of)
    print(f"{hits}/{of} = {hits / of:.4f} [{low:.4f}, {high:.4f}], bar {share}")
    return high >= share


def tally(rows, **wanted):
    found = [row for row in rows if all(getattr(row, key) == value for key, value in wanted.items())]
    return Counter(row.outcome for row in found), len(found)


@pytest.mark.slow
def test_t1_false_alarms(calibrated):
    found, of = tally(calibrated, group="control")
    print(f"T1: {of - found['right']} of {of}")
    assert of >= 200
    assert of - found["right"] <= 2 * of / 200


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.5, 3.0])
def test_t2_one_effect(calibrated, size):
    found, of = tally(calibrated, group="one", size=size)
    assert of >= 300
    assert reaches(found["right"], of, 0.90)
    assert reaches(found["right"] + found["equivalent"], of, 0.97)


@pytest.mark.slow
def test_t3_one_small_effect(calibrated):
    found, of = tally(calibrated, group="one", size=0.1)
    assert reaches(found["right"], of, 0.80)
    assert interval(found["wrong"] + found["failed"], of)[0] <= 0.10


@pytest.mark.slow
def test_t4_after_error(calibrated):
    rows = [row for row in calibrated if row.group == "one" and row.outcome in ("right", "equivalent") and not row.random]
    over = np.array([row.over for row in rows])
    print(f"T4: median {np.median(over):.4f}, 95th percentile {np.percentile(over, 95):.4f} of {len(over)}")
    assert np.median(over) <= 1.01
    assert np.percentile(over, 95) <= 1.05


@pytest.mark.slow
def test_t5_two_effects(calibrated):
    found, of = tally(calibrated, group="two")
    assert reaches(found["right"] + found["equivalent"], of, 0.85)


@pytest.mark.slow
def test_t6_outside_the_library(calibrated):
    found, of = tally(calibrated, group="outside", size=3.0)
    assert reaches(found["right"], of, 0.90)
    assert found["missed"] == 0
