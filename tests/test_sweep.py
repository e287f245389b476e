"""A sweep's seeds, table, file and exit codes."""

import csv
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from whid.errors import WhidError
from whid.sweep import key, sweep

STUDY = """
name: small
seed: 1
plant:
  chain:
    - {kind: linear, num: [1], den: [1, 1]}
    - {kind: piecewise, breaks: [0.5], pieces: [[0], [0, 0, 1]]}
    - {kind: linear, num: [1], den: [0.4, 1]}
  noise: {kind: white, std: 0.05}
experiment:
  dt: 0.1
  parts:
    - {kind: staircase, from: -1, to: 3, step: 0.5, hold_s: 10}
    - {kind: sine, offset: 2, amplitude: 0.8, samples_per_period: [100, 50], periods: 8}
identify: {kind: wiener_hammerstein, orders: [1, 1], whole_record: false}
sweep: {over: {plant.noise.std: [0.01, 0.05]}, repeats: 3}
expect: [{metric: front.gain.error.max, below: 0.05}]
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(STUDY)
    return path


def test_every_repeat_has_a_seed_of_its_own_and_the_engine_does_not_matter(config, tmp_path):
    serial = sweep(config, tmp_path / "a")
    with ThreadPoolExecutor(2) as pool:
        pooled = sweep(config, tmp_path / "b", executor=pool)
    for name, values in serial.values.items():
        assert np.array_equal(values, pooled.values[name], equal_nan=True), name
    errors = serial.values["front.gain.error.max"]
    assert errors.shape == (2, 3)
    assert len(np.unique(errors)) == 6
    assert errors[1].mean() > errors[0].mean()


def test_processes_agree_bit_for_bit(config, tmp_path):
    drawn = ["identify.settle_s=3"]
    serial, two = sweep(config, tmp_path / "a", drawn), sweep(config, tmp_path / "b", drawn, jobs=2)
    assert set(serial.records) == set(two.records) == {""}
    assert all(np.array_equal(serial.values[name], two.values[name], equal_nan=True) for name in serial.values)


def test_a_grown_grid_keeps_the_old_cells(config, tmp_path):
    small = sweep(config, tmp_path / "a")
    grown = sweep(config, tmp_path / "b", ["sweep.over={plant.noise.std: [0.02, 0.05]}"])
    name = "front.gain.error.max"
    assert np.array_equal(small.values[name][1], grown.values[name][1])
    assert key({"a": 1}, 0) != key({"a": 1}, 1)


def test_file_and_table(config, tmp_path):
    found = sweep(config, tmp_path)
    with h5py.File(found.path / "sweep.h5") as file:
        assert np.array_equal(file["metrics/front.gain.error.max"], found.values["front.gain.error.max"])
        assert file["cells/plant.noise.std"][:].tolist() == [0.01, 0.05]
        assert file["metrics/front.gain.error.max"].dims[1].keys() == ["repeat"]
    table = found.table()
    row = dict(zip(table.columns, table.rows[0], strict=True))
    values = found.values["front.gain.error.max"][0]
    assert row["mean ± its error"].value == pytest.approx(values.mean())
    assert row["sd"] == pytest.approx(values.std(ddof=1))
    assert row["RMSE"] == pytest.approx(np.sqrt(np.mean(values**2)))  # of an error about 0
    assert row["50%"] == np.median(values)
    gain = next(name for name in found.values if name.startswith("front.gain@"))
    one = dict(zip(table.columns, found.table([gain]).rows[0], strict=True))
    assert one["RMSE"] == pytest.approx(np.sqrt(np.mean((found.values[gain][0] - found.truth[gain][0]) ** 2)))
    rms = dict(zip(table.columns, found.table(["estimation.rms"]).rows[0], strict=True))
    assert rms["RMSE"] is None  # nothing is true of it
    with (found.path / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["mean ± its error"]) == values.mean()
    assert (found.path / "DONE").exists()
    again = sweep(config, tmp_path)
    assert again.reused
    assert again.path == found.path
    assert again.table() == found.table()
    assert sweep(config, tmp_path, force=True).path.name == found.path.name + ".2"


def test_a_failing_cell_is_a_row_and_the_command_says_so(config, tmp_path):
    from whid.cli import main

    args = ["sweep", str(config), "--out", str(tmp_path), "--json", "--set"]
    run = CliRunner().invoke(main, [*args, "sweep.over={experiment.parts.0.hold_s: [10, 0.2]}"])
    assert run.exit_code == 3
    report = json.loads(run.stdout)
    assert report["failed"] == 3
    assert "/6 failed: stage-too-short" in run.stderr  # as it happens
    assert "\n6/6\n" in run.stderr  # no bar off a terminal
    assert "failed 3 times at 0.2: stage-too-short" in run.stderr
    bad = CliRunner().invoke(main, [*args, "expect=[{metric: front.gain.error.max, below: 1e-9}]"])
    assert bad.exit_code == 4
    shown = CliRunner().invoke(main, ["show", json.loads(bad.stdout)["path"]])
    assert shown.exit_code == 0
    assert "breached" in shown.stdout
    none = CliRunner().invoke(main, [*args, "expect=[{metric: nothing.of.the.sort, below: 1}]"])
    assert none.exit_code == 5


def test_a_fault_in_one_cell_is_told_before_anything_runs(config, tmp_path):
    with pytest.raises(WhidError, match=r"plant.noise.std"):
        sweep(config, tmp_path, ["sweep.over={plant.noise.std: [0.1, -1]}"])
    with pytest.raises(WhidError, match="no `sweep:`"):
        sweep({"name": "a", "data": {"file": "x.csv", "columns": {"input": "u", "output": "y"}, "dt": 1.0},
               "identify": {"kind": "wiener_hammerstein"}}, tmp_path)  # fmt: skip
    assert not any(tmp_path.glob("small-*"))


def test_a_sweep_over_a_trace_study_counts_verdicts(tmp_path):
    """Over the clip that the model lacks: how often it is found, with which numbers, and the error before and after."""
    lag = {"kind": "linear", "num": [1], "den": [0.3, 1]}
    study = {
        "name": "traced",
        "seed": 81700,
        "plant": {"chain": [lag, {"kind": "saturation", "low": -0.8, "high": 0.8}], "noise": {"kind": "white", "std": 0.02}},
        "experiment": {
            "dt": 0.1,
            "parts": [
                {"kind": "multisine", "period": 128, "periods": 4, "rms": 1.0, "band": [0.0, 0.4]},
                {"kind": "multisine", "period": 128, "periods": 2, "rms": 1.0, "band": [0.0, 0.4], "use": "report"},
            ],
        },
        "model": {"chain": [lag]},
        "identify": {"kind": "fit"},
        "trace": {"effects": ["saturation", "lag"]},
        "sweep": {"over": {"plant.chain.1.high": [0.8, 20.0], "plant.chain.1.low": [-0.8, -20.0]}, "mode": "zip"},
        "expect": [{"metric": "verdict.after.over_floor", "below": 1.5}],
    }
    found = sweep(study, tmp_path)
    assert found.failed == 0
    assert found.records == ("the closed loop looks at samples",) * 2
    assert found.values["verdict.explained"][:, 0].tolist() == [1.0, 0.0]
    assert found.values["verdict.nothing_missing"][:, 0].tolist() == [0.0, 1.0]
    high, std = (getattr(found, what)["verdict.saturation@output.high"][:, 0] for what in ("values", "std"))
    assert abs(high[0] - 0.8) < 4 * std[0]
    assert np.isnan(high[1])
    assert found.values["verdict.after.rms"][0, 0] < 0.5 * found.values["verdict.before.rms"][0, 0]
    shown = {row[2] for row in replace(found, expect=()).table().rows}
    assert {"verdict.explained", "verdict.saturation@output.high"} <= shown
    assert found.exit_code == 0


def test_a_sweep_over_a_study_with_tables_runs_the_study(tmp_path):
    over = ["sweep={over: {plant.noise.std: [0.5]}, repeats: 1}", "identify.whole_record=false", "identify.orders=[2, 2]"]
    found = sweep("configs/brouri2019/table-4-1.yaml", tmp_path, over)
    assert found.failed == 0
    assert found.exit_code == 0
    assert abs(found.values["front.gain@0.02"][0, 0] - found.truth["front.gain@0.02"][0]) < 0.003
