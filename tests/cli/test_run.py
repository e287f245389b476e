"""`whid run` as a user meets it: exit codes, what goes to stdout and what to stderr."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from tests.small_study import SmallStudy, bound, small_study
from whid.cli import main

CONFIG = """
name: tiny
seed: 3
plant:
  chain:
    - {kind: linear, num: [1], den: [0.2, 1]}
    - {kind: dead_zone, low: -0.5, high: 0.5}
  noise: {kind: white, std: 0.02}
experiment:
  dt: 0.05
  parts:
    - {kind: staircase, from: -2, to: 2, step: 0.25, hold_s: 10, return: true}
    - {kind: hold, level: 1.3, hold_s: 10, use: report}
identify: {kind: wiener_hammerstein}
expect: [{metric: report.rms, below: 0.2}]
"""


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(CONFIG)
    return path


def whid(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


def test_a_yaml_file_becomes_a_summary_and_a_folder(config, tmp_path):
    done = whid("run", config, "--out", tmp_path / "runs")
    assert done.exit_code == 0, done.stderr
    for text in ("Study tiny", "static curve", "Model", "Fit", "report", "pass", "result.h5"):
        assert text in done.stdout
    (folder,) = (tmp_path / "runs").iterdir()
    assert str(folder) in done.stdout
    again = whid("run", config, "--out", tmp_path / "runs")
    assert again.exit_code == 0
    assert "reused" in again.stdout
    quiet = whid("run", config, "--out", tmp_path / "runs", "--quiet")
    assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (0, f"{folder}\n", "")


def test_json_is_one_object_and_nothing_else(config, tmp_path):
    done = whid("run", config, "--out", tmp_path, "--json", "--set", "plant.noise.std=0.01")
    found = json.loads(done.stdout)
    assert (found["name"], found["reused"], found["error"], found["exit_code"]) == ("tiny", False, None, 0)
    assert found["metrics"]["report.rms"].keys() == {"value", "std"}
    assert 0.008 < found["metrics"]["report.rms"]["value"] < 0.2
    assert found["expect"][0]["verdict"] == "pass"
    assert found["seconds"] > 0
    assert any(table["title"] == "Model" for table in found["tables"])
    shown = json.loads(whid("show", found["path"], "--json").stdout)
    assert shown["metrics"] == found["metrics"]
    assert shown["tables"] == found["tables"]


@pytest.mark.parametrize(("limit", "code", "verdict"), [("report.rms", 4, "breached"), ("no.such", 5, "not measured")])
def test_a_bound_that_does_not_hold_ends_with_its_code(config, tmp_path, limit, code, verdict):
    override = f"expect=[{{metric: {limit}, below: 1.0e-9}}]"
    for _ in range(2):  # run, then reused
        done = whid("run", config, "--out", tmp_path, "--set", override)
        assert done.exit_code == code
        assert verdict in done.stdout


def test_a_faulty_config_ends_with_2_and_runs_nothing(config, tmp_path):
    done = whid("run", config, "--out", tmp_path / "runs", "--set", "plant.noise.sdt=1")
    assert done.exit_code == 2
    assert "plant.noise.sdt" in done.stderr
    assert done.stdout == ""
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(("limit", "code"), [("1KB", 2), ("much", 2), ("8 GB", 0)])
def test_memory_is_bounded(config, tmp_path, limit, code):
    done = whid("run", config, "--out", tmp_path / "runs", "--max-memory", limit)
    assert done.exit_code == code, done.stderr
    assert (tmp_path / "runs").exists() == (code == 0)


def test_a_stage_that_fails_ends_with_3_and_says_where_the_rest_is(config, tmp_path, monkeypatch):
    study = small_study(identify=SmallStudy(fail="named"), expect=(bound("report.rms", 1.0),))
    monkeypatch.setattr("whid.flow.load_study", lambda *a: study)
    done = whid("run", config, "--out", tmp_path / "runs")
    assert done.exit_code == 3
    assert "error[block-no-steady-state]" in done.stderr
    assert "try:" in done.stderr
    assert "Levels" in done.stdout
    (folder,) = (tmp_path / "runs").iterdir()
    assert str(folder) in done.stdout


def test_force_runs_again_beside(config, tmp_path):
    paths = [
        json.loads(whid("run", config, "--out", tmp_path / "runs", "--json", "--force").stdout)["path"] for _ in range(2)
    ]
    assert paths[1] == f"{paths[0]}.2"


def test_a_missing_config_is_named(tmp_path):
    done = whid("run", tmp_path / "none.yaml")
    assert done.exit_code in (2, 3)
    assert "none.yaml" in done.stderr
