"""`whid predict`: a run's model on a new record, scored where y is there."""

import json

import numpy as np
import pytest

from tests.cli.test_fit import STUDY
from whid import flow
from whid.predict import predict
from whid.record import Record


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))


@pytest.fixture
def run(whid, tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    return json.loads(whid("fit", "study.yaml", "--json").stdout)["path"]


def table(path, **columns):
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n")


def read(path):
    return np.genfromtxt(path, delimiter=",", names=True)


def test_it_predicts_and_scores(whid, run, tmp_path):
    model = flow.load(run).model
    t = 0.05 * np.arange(300)
    u = np.repeat(np.random.default_rng(1).normal(size=30), 10) * 1.5
    expected = predict(model.system.tree, Record(u=u, y=u, dt=0.05))
    y = expected + 0.1 * np.random.default_rng(2).normal(size=300)
    table(tmp_path / "new.csv", t=t, u=u, y=y)
    done = whid("predict", run, "--data", "new.csv", "--out", "pred.csv", "--json")
    assert done.exit_code == 0, done.output
    found = read(tmp_path / "pred.csv")
    assert found.dtype.names == ("t", "u", "y", "y_hat", "y_hat_std")
    np.testing.assert_allclose(found["y_hat"], expected, atol=1e-6)
    np.testing.assert_allclose(found["y"], y, atol=1e-6)
    assert 0 < found["y_hat_std"].max() < 0.05
    assert json.loads(done.stdout)["report.rms"] == pytest.approx(np.sqrt(np.mean((y - expected) ** 2)), rel=1e-4)
    again = whid("predict", run, "--data", "new.csv", "--out", "pred.csv")
    assert again.exit_code == 2
    assert "file-exists" in again.stderr


def test_columns_by_name_and_a_file_without_y(whid, run, tmp_path):
    t = 0.05 * np.arange(100)
    table(tmp_path / "odd.csv", seconds=t, drive=np.sin(t), speed=np.sin(t - 0.4), other=t)
    named = whid("predict", run, "--data", "odd.csv", "--columns", "time=seconds,input=drive,output=speed", "--out", "a.csv")
    assert named.exit_code == 0, named.output
    assert "report.rms" in named.stdout
    table(tmp_path / "alone.csv", t=t, u=np.sin(t))
    alone = whid("predict", run, "--data", "alone.csv", "--out", "b.csv")
    assert alone.exit_code == 0, alone.output
    assert "rms" not in alone.stdout
    a, b = read(tmp_path / "a.csv"), read(tmp_path / "b.csv")
    np.testing.assert_allclose(a["y_hat"], b["y_hat"], atol=1e-6)
    assert np.isnan(b["y"]).all()


def test_faults_are_named(whid, run, tmp_path):
    assert "run-not-found" in whid("predict", tmp_path / "none", "--data", "x.csv").stderr
    assert "data-file" in whid("predict", run, "--data", "x.csv").stderr
    table(tmp_path / "new.csv", t=np.arange(30.0), u=np.sin(np.arange(30.0)), y=np.cos(np.arange(30.0)))
    wrong = whid("predict", run, "--data", "new.csv", "--columns", "drive=u")
    assert wrong.exit_code == 2
    assert "time=…,input=…,output=…" in wrong.stderr


def test_an_input_beyond_what_the_model_was_made_from(whid, run, tmp_path):
    table(tmp_path / "far.csv", t=0.05 * np.arange(40), u=np.linspace(-9, 900, 40))
    assert (
        "extrapolated: the input goes from -9 to 900, the model was made from"
        in whid("predict", run, "--data", "far.csv").stdout
    )
    assert whid("predict", run, "--data", "far.csv", "--dt", "-0.1").exit_code == 2
