"""whid list and whid diff on runs and sweeps."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from tests.small_study import EXPERIMENT, PLANT, small_study
from tests.test_sweep import STUDY
from whid import flow
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.cli import main
from whid.compare import Tolerance, models
from whid.files.journal import Journal, Outcome
from whid.simulate import simulate
from whid.sweep import sweep
from whid.system import System


def command(*args):
    run = CliRunner().invoke(main, list(map(str, args)))
    assert "Traceback" not in run.output
    return run


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs")
    for seed in (7, 7, 8):
        flow.run(small_study(seed=seed), out, force=True)
    config = out.parent / "small.yaml"
    config.write_text(STUDY.replace("repeats: 3", "repeats: 1").replace("name: small", "name: grid"))
    for _ in range(2):
        sweep(config, out, force=True)
    with Journal(out / "half-0123456789.unfinished", "one", "name: half", 4) as journal:
        journal.add([((0, 0), Outcome({}))])
    (out / "notes").mkdir()
    return out


def test_list_names_everything_of_whid_and_nothing_else(out):
    rows = json.loads(command("list", out, "--json").stdout)["rows"]
    kinds = {row["name"]: (row["kind"], row["headline"]) for row in rows}
    assert sorted(kind for kind, _ in kinds.values()) == ["run", "run", "run", "sweep", "sweep", "unfinished sweep"]
    assert kinds["half-0123456789.unfinished"][1].startswith("1 of 4 done")
    assert any("report.rms" in words for _, words in kinds.values())
    assert command("list", out / "nowhere").exit_code != 0
    assert "nothing of whid" in command("list", out / "notes").stdout


def test_diff_of_runs(out):
    same = sorted(path for path in out.glob("small-*") if path.name.endswith(".2") or (out / f"{path.name}.2").exists())
    other = next(path for path in out.glob("small-*") if path not in same)
    equal = command("diff", *same)
    assert (equal.exit_code, equal.stdout) == (0, "no difference\n")
    differing = command("diff", same[0], other, "--json")
    assert differing.exit_code == 1
    tables = {table["title"]: table["rows"] for table in json.loads(differing.stdout)["tables"]}
    assert tables["Config"] == [{"what": "seed", "A": 7, "B": 8}]
    assert {row["what"] for row in tables["Metrics"]} >= {"estimation.rms", "report.rms"}
    nowhere = command("diff", same[0], out / "nowhere")
    assert nowhere.exit_code == 2
    assert "nowhere: no config.yaml here" in nowhere.output


def test_diff_of_sweeps(out):
    assert command("diff", *sorted(out.glob("grid-*"))).exit_code == 0
    mixed = command("diff", next(out.glob("grid-*")), next(out.glob("small-*")))
    assert mixed.exit_code == 2
    assert "one is a sweep" in mixed.stderr


def test_a_gain_that_moved_between_blocks_is_no_difference():
    record = simulate(PLANT, EXPERIMENT, np.random.default_rng(1))

    def plant(front, scale, lag=0.2):
        curve = Piecewise(breaks=(0.5 * front,), pieces=((0.0,), (-0.5 * scale, scale / front)))
        return System(chain=(Linear(num=(front,), den=(lag, 1.0)), curve, Linear(num=(3.0 / scale,), den=(0.1, 1.0))))

    assert list(models(plant(1.0, 1.0), plant(4.0, 2.0), record, Tolerance())) == []
    assert len(list(models(plant(1.0, 1.0), plant(1.0, 1.0, lag=0.21), record, Tolerance()))) == 1
