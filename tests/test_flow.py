"""The flow around a method: folders, hashes, wishes, faults, bounds, interruptions."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.small_study import EXPERIMENT, PLANT, Levels, SmallStudy, bound, small_study
from whid import flow, plots, work
from whid.blocks.linear import Linear
from whid.errors import WhidError
from whid.experiments._experiment import Adaptive
from whid.experiments.hold import Hold
from whid.files.source import DataSource
from whid.methods._method import Answered, Wanted
from whid.record import Record
from whid.result import Asked, Check
from whid.signal import held

DRAW = plots.draw


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))  # they take longer than all the rest


def files(path: Path) -> set[str]:
    return {item.name for item in path.iterdir()}


def test_a_run_is_kept_whole_and_reads_back_the_same(tmp_path):
    steps = []
    result = flow.run(small_study(), tmp_path, watch=lambda step, seconds: steps.append(step))
    assert result.error is None
    assert result.exit_code == 0
    assert files(result.path) == {"config.yaml", "result.h5", "summary.md", "log.txt", "DONE"}
    assert result.path.name == f"small-{result.provenance['hash'][:10]}"
    assert (result.path / "DONE").read_text().strip() == result.provenance["hash"]
    assert [s for s in steps if s in result.stages] == ["levels", "levels_2", "model"] == list(result.stages)
    again = flow.load(result.path)
    assert again.metrics == result.metrics
    assert again.model.system == PLANT == again.truth
    assert again.tables == result.tables
    for record, original, residual in zip(again.records, result.records, again.residuals, strict=True):
        np.testing.assert_array_equal(record.y, original.y)
        assert record.parts == original.parts
        assert (record.dt, record.intersample, record.initial, record.units) == (0.05, "zoh", "rest", original.units)
        assert len(residual) == len(record)


def test_the_seed_decides_the_noise_and_nothing_else_does(tmp_path):
    first, again, other = (flow.run(small_study(seed=seed), tmp_path / out) for seed, out in ((7, "a"), (7, "b"), (8, "a")))
    np.testing.assert_array_equal(first.records[0].y, again.records[0].y)
    assert first.path.name == again.path.name != other.path.name
    assert np.abs(first.records[0].y - other.records[0].y).max() > 0.05


def test_each_record_has_noise_of_its_own(tmp_path):
    twin = replace(EXPERIMENT, name="twin")
    result = flow.run(small_study(experiment=(EXPERIMENT, twin), identify=SmallStudy(wants=False)), tmp_path)
    a, b = (record.y - result.records[0].y.mean() for record in result.records)
    assert np.std(a - b) == pytest.approx(0.05 * np.sqrt(2), rel=0.06)  # 2620 samples: 0.06 is four standard errors


def test_the_same_study_is_reused_and_force_makes_a_sibling(tmp_path):
    first = flow.run(small_study(), tmp_path)
    second = flow.run(small_study(), tmp_path)
    assert second.reused
    assert second.path == first.path
    stamp = (first.path / "result.h5").stat().st_mtime_ns
    forced = [flow.run(small_study(), tmp_path, force=True) for _ in range(2)]
    assert [run.path.name for run in forced] == [f"{first.path.name}.2", f"{first.path.name}.3"]
    assert (first.path / "result.h5").stat().st_mtime_ns == stamp
    assert flow.run(small_study(), tmp_path).path.name == f"{first.path.name}.3"


def test_another_number_in_the_config_is_another_run(tmp_path):
    names = {flow.run(small_study(expect=(bound("report.rms", x),)), tmp_path).path.name for x in (0.1, 0.2)}
    assert len(names) == 2


def test_the_data_decide_the_hash(tmp_path):
    names = set()
    for scale in (1, 2):
        table = np.column_stack([np.repeat([0.0, 1.0, 0.5], 40), scale * np.arange(120.0) ** 0.5])
        np.savetxt(tmp_path / "data.csv", table, delimiter=",", header="u,y", comments="")
        source = DataSource(file=str(tmp_path / "data.csv"), dt=0.1)
        names.add(flow.provenance("same text", [flow.locate(source.file, tmp_path)])["hash"])
    assert len(names) == 2


def test_a_wish_is_granted_on_a_simulated_plant(tmp_path):
    result = flow.run(small_study(), tmp_path)
    assert [record.name for record in result.records] == ["record", "wanted_1"]
    assert result.records[1].parts[0].level == 0.25
    assert result.stages["levels_2"].mean[0] == pytest.approx(0.0, abs=0.03)  # inside the dead zone; 50 samples of 0.05
    plan = ({"kind": "hold", "level": 0.25, "hold_s": 5.0},)
    asked = Asked("a level inside the dead zone", 0.01, "", plan, 100, "wanted_1")
    assert result.asked == flow.load(result.path).asked == (asked,)


def test_a_wish_is_not_granted_on_measured_data_and_the_method_finishes(tmp_path):
    simulated = flow.run(small_study(), tmp_path).records[0]
    table = np.column_stack([simulated.u, simulated.y])
    np.savetxt(tmp_path / "data.csv", table, delimiter=",", header="u,y", comments="")
    parts = tuple(part for part in simulated.parts if part.kind == "hold")
    source = DataSource(file="data.csv", dt=0.05, parts=parts, initial="rest")
    config = {"plant": None, "experiment": (), "data": source, "name": "measured"}
    (tmp_path / "study.yaml").touch()
    result = flow.run(small_study(**config | {"data": replace(source, file=str(tmp_path / "data.csv"))}), tmp_path)
    assert result.error is None
    assert list(result.stages) == ["levels", "model"]
    assert [asked.refused for asked in result.asked] == ["the data are measured: `whid next` writes the plan"]
    assert result.asked[0].record == ""
    assert result.truth is None
    np.testing.assert_allclose(result.stages["levels"].mean, flow.run(small_study(), tmp_path).stages["levels"].mean)


@pytest.mark.parametrize(
    ("adaptive", "why"),
    [
        (None, "no `adaptive:` in the experiment"),
        (Adaptive(max_samples=99), "beyond the budget: 100 samples more, 0 of 99 used"),
    ],
)
def test_a_wish_beyond_the_budget_is_refused_and_the_method_finishes(tmp_path, adaptive, why):
    result = flow.run(small_study(experiment=(replace(EXPERIMENT, adaptive=adaptive),)), tmp_path)
    assert result.error is None
    assert list(result.stages) == ["levels", "model"]
    assert [asked.refused for asked in result.asked] == [why]
    assert why in (result.path / "summary.md").read_text()


def test_the_budget_is_for_all_wishes_together_and_answers_are_kept(tmp_path):
    @dataclass(frozen=True, kw_only=True)
    class Greedy(SmallStudy):
        def __call__(self, records, model=None):
            for count in (3, 2, 1):
                if (yield Wanted(tuple(Hold(level=1.0, hold_s=1.0) for _ in range(count)), "more", 0.1, "it")) is not None:
                    yield Answered(f"{count} told")
            yield from super().__call__(records, model)

    study = small_study(experiment=(replace(EXPERIMENT, adaptive=Adaptive(max_experiments=4)),))
    result = flow.run(replace(study, identify=Greedy(wants=False)), tmp_path)
    assert [(asked.answer, asked.refused) for asked in result.asked] == [
        ("3 told", ""), ("", "beyond the budget: 2 experiments more, 3 of 4 used"), ("1 told", "")
    ]  # fmt: skip
    assert [record.name for record in result.records] == ["record", "wanted_1", "wanted_3"]
    (table,) = (t for t in result.tables if t.title == "Experiments asked for")
    assert table.rows[0] == (1, "more", "3 holds, 60 samples", "0.1 of it", "3 told")
    assert flow.load(result.path).asked == result.asked


def test_the_method_never_sees_a_report_part(tmp_path, monkeypatch):
    seen = []

    def spy(self, records, model=None):
        seen.extend(records)
        yield from original(self, records, model)

    original = SmallStudy.__call__
    monkeypatch.setattr(SmallStudy, "__call__", spy)
    result = flow.run(small_study(), tmp_path)
    hidden = result.records[0].using("report")
    assert hidden.sum() == 80
    assert np.isnan(seen[0].y[hidden]).all()
    assert np.isfinite(seen[0].y[~hidden]).all()
    assert not seen[0].mask[hidden].any()
    assert np.isfinite(result.residuals[0][hidden]).all()  # opened afterwards, for the score
    assert "report.rms" in result.metrics


@pytest.mark.parametrize(
    ("fail", "code", "exit_code"),
    [("named", "block-no-steady-state", 3), ("bug", "method-failed", 3), ("stopped", "interrupted", 130)],
)
def test_a_stage_that_fails_keeps_those_before_it(tmp_path, fail, code, exit_code):
    result = flow.run(small_study(identify=SmallStudy(fail=fail)), tmp_path)
    assert (result.error.code, result.exit_code) == (code, exit_code)
    assert list(result.stages) == ["levels"]
    assert "DONE" not in files(result.path)
    assert json.loads((result.path / "error.json").read_text())["code"] == code
    assert code in (result.path / "log.txt").read_text()
    kept = flow.load(result.path)
    np.testing.assert_array_equal(kept.stages["levels"].mean, result.stages["levels"].mean)
    assert kept.error == result.error
    with pytest.raises(WhidError) as fault:
        _ = kept.model
    assert fault.value.code == code
    retry = flow.run(small_study(identify=SmallStudy(fail=fail)), tmp_path)
    assert not retry.reused
    assert retry.path.name == f"{result.path.name}.2"


def test_faulty_data_are_a_fault_of_the_config_and_leave_nothing(tmp_path):
    (tmp_path / "data.csv").write_text("u,y\n" + "0,1\n" * 40 + "1,oops\n")
    source = DataSource(file=str(tmp_path / "data.csv"), dt=0.1)
    with pytest.raises(WhidError, match=r"data\.csv") as fault:
        flow.run(small_study(plant=None, experiment=(), data=source), tmp_path / "runs")
    assert fault.value.exit_code == 2
    assert list((tmp_path / "runs").iterdir()) == []


def test_a_bug_leaves_its_traceback_in_the_log_only(tmp_path, capsys):
    result = flow.run(small_study(identify=SmallStudy(fail="bug")), tmp_path)
    assert "ZeroDivisionError" in (result.path / "log.txt").read_text()
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("bounds", "exit_code"),
    [
        ((bound("report.rms", 1.0),), 0),
        ((bound("report.rms", 1e-6),), 4),
        ((bound("no.such.metric", 1.0),), 5),
        ((bound("no.such.metric", 1.0), bound("report.rms", 1e-6)), 4),
    ],
)
def test_bounds_decide_the_exit_code_also_when_reused(tmp_path, bounds, exit_code):
    study = small_study(expect=bounds)
    assert [flow.run(study, tmp_path).exit_code for _ in range(2)] == [exit_code] * 2


def test_a_bound_holds_strictly_and_never_for_nan():
    assert Check("m", 1.0, below=1.0).verdict == "breached"
    assert Check("m", float("nan"), above=0.0).verdict == "breached"
    assert Check("m", 1.0, below=2.0, above=0.5).verdict == "pass"
    assert Check("m", 0.4, below=2.0, above=0.5).verdict == "breached"


def test_a_study_beyond_the_memory_is_refused_before_it_starts(tmp_path):
    with pytest.raises(WhidError, match="needs about 200 MB, 1 MB are allowed") as fault:
        flow.run(small_study(experiment=(replace(EXPERIMENT, adaptive=None),)), tmp_path / "runs", max_memory=1e6)
    assert fault.value.code == "memory"
    assert not (tmp_path / "runs").exists()


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(WhidError, match="runs") as fault:
        flow.run(small_study(), tmp_path / "runs")
    assert fault.value.code == "run-folder"


def test_a_picture_that_fails_costs_a_warning_only(tmp_path, monkeypatch):
    def broken(run, figure):
        raise RuntimeError("no ink")

    monkeypatch.setattr("whid.plots.draw", DRAW)
    monkeypatch.setattr("whid.plots.residual.draw", broken)
    result = flow.run(small_study(), tmp_path)
    assert result.error is None
    assert "residual.png" not in result.pictures
    assert any("no ink" in warning for warning in result.warnings)
    assert "no ink" in (result.path / "summary.md").read_text()
    assert set(result.pictures) < files(result.path)


def test_a_wrong_intersample_is_warned_of_by_name():
    rng = np.random.default_rng(11)
    u = rng.standard_normal(4000)
    lag = Linear(num=(1.0,), den=(0.3, 1.0))
    y = lag.step(held(u, 0.1, "foh", 0.0, lag.panel_order(0.1)))[0].values + 0.01 * rng.standard_normal(4000)
    y[:7] = np.nan  # a masked stretch is left out
    wrong, right = (Record(u=u, y=y, dt=0.1, intersample=between, name="bench") for between in ("zoh", "foh"))
    (warning,) = work.input_doubts([wrong])
    assert "bench" in warning
    assert "`intersample: zoh` does not fit" in warning
    assert "`intersample: foh`" in warning
    assert list(work.input_doubts([right])) == []


def test_a_table_that_fails_costs_the_summary_only(tmp_path, monkeypatch):
    monkeypatch.setattr(Levels, "table", lambda self: 1 / 0)
    result = flow.run(small_study(), tmp_path)
    assert "ZeroDivisionError" in (result.path / "summary.md").read_text()
    assert flow.load(result.path).metrics == result.metrics


SLOW = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background is born deaf to Ctrl-C
from tests.small_study import small_study
from whid import flow, score
score.score = lambda *a: (print("scoring", flush=True), time.sleep(60))
flow.run(small_study(), sys.argv[1])
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_killed_on_the_way_the_next_run_does_not_stumble(tmp_path, how):
    child = subprocess.Popen([sys.executable, "-c", SLOW, str(tmp_path)], stdout=subprocess.PIPE, text=True, env=os.environ)
    assert child.stdout.readline().strip() == "scoring"
    time.sleep(0.1)
    child.send_signal(how)
    child.wait(30)
    left = [path for path in tmp_path.iterdir()]
    assert len(left) == 1
    assert not (left[0] / "DONE").exists()
    if how == signal.SIGINT:  # Ctrl-C keeps what was finished
        assert list(flow.load(left[0]).stages) == ["levels", "levels_2", "model"]
    result = flow.run(small_study(), tmp_path)
    assert (result.path / "DONE").exists()
    assert not result.reused
    assert flow.run(small_study(), tmp_path).reused


def _one(out: str) -> str:
    return flow.run(small_study(), out, force=True).path.name


def test_two_processes_at_once_keep_apart(tmp_path):
    with multiprocessing.get_context("fork").Pool(2) as pool:
        names = pool.map(_one, [str(tmp_path)] * 4, chunksize=1)
    assert len(set(names)) == 4
    assert {flow.load(tmp_path / name).metrics["report.rms"] for name in names} == {
        flow.load(tmp_path / names[0]).metrics["report.rms"]
    }
    assert all(not path.name.startswith(".") for path in tmp_path.iterdir())


def test_python_has_the_same_two_functions(tmp_path):
    import whid

    result = whid.run(small_study(), tmp_path)
    assert whid.load(result.path).metrics == result.metrics
    assert repr(result).startswith("<Result small: 2 records, ")
    assert {"run", "load"} <= set(dir(whid))
    with pytest.raises(WhidError) as fault:
        whid.load(tmp_path)
    assert fault.value.code == "run-not-found"
