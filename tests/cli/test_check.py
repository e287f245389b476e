import json
from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[2] / "configs"


def test_an_overview_of_the_starter(whid):
    found = whid("check", CONFIGS / "starter.yaml")
    assert found.exit_code == 0, found.stderr
    assert "u → linear(num [1], den [16, 10, 1]) → piecewise(" in found.stdout
    assert "7335 samples of 1 s" in found.stdout
    assert "wiener_hammerstein" in found.stdout
    assert "memory" in found.stdout


def test_as_json(whid):
    rows = json.loads(whid("check", CONFIGS / "starter.yaml", "--json", "--set", "name=other").stdout)["rows"]
    assert {"section": "name", "what": "other"} in rows


def test_design_p_has_its_samples(whid):
    assert "29212 samples of 0.523599 s" in whid("check", CONFIGS / "brouri2019/table-4-1.yaml").stdout


def test_every_fault_at_once(whid, tmp_path):
    (tmp_path / "s.yaml").write_text("nam: x\nplant:\n  chain:\n  - {kind: dead_zone, low: a}\n")
    found = whid("check", "s.yaml", "--set", "seed=-1")
    assert found.exit_code == 2
    assert found.stdout == ""
    told = [line for line in found.stderr.splitlines() if line.startswith("error")]
    expected = [
        "error[config-value]: --set seed: must be >= 0, not -1",
        "error[config-missing]: s.yaml:1:1: name: is missing",
        "error[config-missing]: s.yaml:1:1: identify: is missing",
        "error[config-unknown]: s.yaml:1:1: nam: unknown key, did you mean name? (allowed: name, seed, plant, experiment, ",
        "error[config-missing]: s.yaml:4:5: plant.chain[0].high: is missing",
        "error[config-value]: s.yaml:4:28: plant.chain[0].low: must be a number, not the text 'a'",
    ]
    assert [line[: len(start)] for line, start in zip(told, expected, strict=True)] == expected


def test_a_study_beyond_its_memory(whid):
    long = "experiment.parts[0].hold_s=1e9"
    found = whid("check", CONFIGS / "starter.yaml", "--set", long, "--set", "identify={kind: parametric}")
    assert found.exit_code == 2
    assert "error[memory]: this study needs about" in found.stderr
    assert whid("check", CONFIGS / "starter.yaml", "--max-memory", "1MB").exit_code == 2
    chunked = whid("check", CONFIGS / "starter.yaml", "--set", long)  # its method goes through them in chunks
    assert chunked.exit_code == 0
    assert "; 300 MB in chunks, where that is more than allowed" in chunked.stdout
    assert "in chunks" not in whid("check", CONFIGS / "starter.yaml").stdout  # it would take more
    assert "such as 4GB" in whid("check", CONFIGS / "starter.yaml", "--max-memory", "much").stderr


def test_a_data_file_that_is_not_there(whid, tmp_path):
    (tmp_path / "m.yaml").write_text("name: m\ndata: {file: no.csv}\nidentify: {kind: wiener_hammerstein}\n")
    found = whid("check", "m.yaml")
    assert found.exit_code == 2
    assert "error[data-file]: no.csv: no such file" in found.stderr
    (tmp_path / "no.csv").write_text("t,u,y\n0,1,2\n1,2,3\n")
    assert whid("check", "m.yaml").exit_code == 0


@pytest.mark.parametrize("name", ["absent.yaml", "."])
def test_a_config_that_is_not_there(whid, name):
    found = whid("check", name)
    assert found.exit_code == 2
    assert found.stderr.startswith(f"error[config-file]: {name}: ")


def test_every_value_of_a_sweep_is_checked(whid, tmp_path):
    text = (CONFIGS / "starter.yaml").read_text("utf-8")
    (tmp_path / "s.yaml").write_text(text + "sweep: {over: {plant.noise.std: [0.1, -1], plant.nois.std: [2]}, repeats: 3}\n")
    found = whid("check", "s.yaml")
    assert found.exit_code == 2
    assert "s.yaml: sweep.over: plant.noise.std: must be >= 0, not -1" in found.stderr
    assert "plant.nois is not there, did you mean noise?" in found.stderr
    (tmp_path / "t.yaml").write_text(text + "sweep: {over: {plant.noise.std: [0.1, 1]}, repeats: 3}\n")
    assert "grid over plant.noise.std (2), 3 repeats" in whid("check", "t.yaml").stdout


def test_a_column_that_a_data_file_does_not_have(whid, tmp_path):
    (tmp_path / "m.yaml").write_text(
        "name: m\ndata: {file: d.csv, columns: {input: Valv}}\nidentify: {kind: wiener_hammerstein}\n"
    )
    (tmp_path / "d.csv").write_text("t,valve,y\n0,1,2\n1,2,3\n")
    found = whid("check", "m.yaml")
    assert found.exit_code == 2
    assert "error[data-column]: d.csv: no column 'Valv', did you mean 'valve'? The file has t, valve, y" in found.stderr
    assert "columns (input: valve)" in whid("check", "m.yaml", "--set", "data.columns.input=valve").stdout


def test_a_fault_of_a_sweeps_values_is_said_once_and_where_it_stands(whid, tmp_path):
    (tmp_path / "s.yaml").write_text((CONFIGS / "starter.yaml").read_text() + "sweep: {over: {plant.noise.stdd: [1, 2]}}\n")
    told = whid("check", "s.yaml").stderr
    assert told.count("unknown key, did you mean std?") == 1
    assert "s.yaml: sweep.over: plant.noise.stdd: unknown key" in told
