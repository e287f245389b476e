"""whid trace from a file to a refined study: the verdict, its report data kept closed, the after-error reproduced."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from tests.trace_plants import PLANT, believed, lacking, measured
from whid import flow
from whid.blocks.saturation import Saturation
from whid.cli import main
from whid.config.yaml import dump
from whid.kinds import plain
from whid.trace import Trace, Verdict, as_object, trace

CLIPPED = lacking(3, Saturation(low=-1.0, high=1.1))
KEYS = {"verdict", "effects", "equivalent", "before", "after", "floor", "steps", "seconds"}


@pytest.fixture
def study(tmp_path):
    record = measured(CLIPPED, 11)
    time = np.arange(len(record)) * record.dt
    np.savetxt(
        tmp_path / "bench.csv", np.column_stack([time, record.u, record.y]), delimiter=",", header="t,u,y", comments=""
    )
    parts = [plain(part) for part in record.parts]
    tree = {
        "name": "bench",
        "data": {
            "file": "bench.csv",
            "columns": {"time": "t", "input": "u", "output": "y"},
            "initial": "rest",
            "parts": parts,
        },
        "model": plain(believed(PLANT, 11)),
        "identify": {"kind": "fit"},
    }
    path = tmp_path / "study.yaml"
    path.write_text(dump(tree))
    return path


def test_trace_names_the_clip_and_the_refined_study_reproduces_the_error(study, tmp_path, monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    before = study.read_text()
    out = CliRunner().invoke(main, ["trace", str(study), "--out", str(tmp_path / "runs"), "--json"])
    assert out.exit_code == 0, out.output
    found = json.loads(out.stdout)
    assert set(found) >= KEYS
    assert found["verdict"] == "explained"
    assert [(e["kind"], e["place"]) for e in found["effects"]] == [("saturation", "output")]
    high, std = found["effects"][0]["parameters"]["high"], found["effects"][0]["std"]["high"]
    assert abs(high - 1.1) < 4 * std
    assert found["after"]["rms"] < 0.6 * found["before"]["rms"]
    assert study.read_text() == before
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    again = flow.run(found["refined"], tmp_path / "again")
    assert again.error is None
    assert again.metrics["report.rms"] == pytest.approx(found["after"]["rms"], rel=1e-6)
    kept = flow.load(next((tmp_path / "runs").iterdir()))
    assert isinstance(kept.stages["verdict"], Verdict)
    assert as_object(kept.stages["verdict"])["effects"] == found["effects"]


def test_report_data_have_no_part_in_the_verdict():
    record = measured(CLIPPED, 12)
    blind = replace(record, y=np.where(record.using("report"), np.nan, record.y))
    verdicts = []
    for each in (record, blind):
        stages = list(trace(believed(PLANT, 12), [each], Trace(effects=("saturation", "lag"))))
        verdicts.append(stages[-2])
    one, other = (
        repr(v._replace(seconds=0.0, before=None, after=None, steps=tuple(s._replace(errors=None) for s in v.steps)))
        for v in verdicts
    )
    assert one == other
    assert np.isnan(verdicts[1].after.rms)


def test_nothing_missing():
    verdict = list(trace(believed(PLANT, 13), [measured(PLANT, 13)], Trace()))[-2]
    assert verdict.verdict == "nothing missing"
    assert verdict.effects == ()
    assert verdict.after == verdict.before


def test_samples_that_hang_are_told_before_other_noise_takes_them():
    record, rng = measured(PLANT, 14), np.random.default_rng(15)
    y = record.y.copy()
    for start in rng.choice(np.flatnonzero(record.using("estimation"))[20:-20:20], 30, replace=False):
        y[start : start + 6] = y[start - 1]
    others = ("outliers", "coloured_noise", "jitter", "level_noise")
    verdict = list(trace(believed(PLANT, 14), [replace(record, y=y)], Trace(effects=("dropouts", *others))))[-2]
    assert [(e.kind, e.place) for e in verdict.effects] == [("dropouts", "output")]
