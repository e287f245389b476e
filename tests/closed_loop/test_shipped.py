"""The studies in configs/closed_loop/: what they are made of, and what `whid trace` says of them."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.closed_loop.calibrate import traced
from tests.closed_loop.score import score
from tests.closed_loop.shipped import CONFIGS, STUDIES, TRUTH, make

ROOT = Path(__file__).parents[2]


def truth_of(name):
    return json.loads((TRUTH / f"{name}.json").read_text())


def outcome(name):
    answer, note = traced(CONFIGS / f"{name}.yaml")
    found = score(truth_of(name), answer)
    print(f"{name}: {found.outcome}, said {found.said} {note}")
    return found


def test_there_are_as_many_as_promised():
    hidden = Counter("outside" if truth["outside"] else len(truth["effects"]) for truth in map(truth_of, STUDIES))
    assert hidden[1] >= 12
    assert min(hidden[2], hidden[0], hidden["outside"]) >= 2
    assert len({truth_of(name)["family"] for name in STUDIES}) == 7
    assert all((CONFIGS / f"{name}.npz").stat().st_size < 100_000 for name in STUDIES)


@pytest.mark.parametrize("name", ["rig_07", *(pytest.param(n, marks=pytest.mark.slow) for n in STUDIES if n != "rig_07")])
def test_they_are_what_their_seeds_make(name, tmp_path):
    made = make(name, tmp_path / "seen", tmp_path / "truth")
    assert made.read_text() == (CONFIGS / f"{name}.yaml").read_text()
    assert json.loads((tmp_path / "truth" / f"{name}.json").read_text()) == truth_of(name)
    with np.load(CONFIGS / f"{name}.npz") as shipped, np.load(tmp_path / "seen" / f"{name}.npz") as again:
        assert all((shipped[key] == again[key]).all() for key in ("u", "y"))


def test_they_load():
    from whid.config.load import load_study
    from whid.files.ingest import ingest

    for name in STUDIES:
        study = load_study(CONFIGS / f"{name}.yaml")
        record = ingest(study.data, CONFIGS).record
        assert record.using("report").any()
        assert study.model is not None


def test_nothing_that_identifies_reads_the_truth():
    """No file of the package mentions the folder, and the folder of the studies holds nothing of it."""
    words = ("closed_loop/truth", "tests.closed_loop", "report_noise_rms")
    for file in (ROOT / "whid").rglob("*.py"):
        assert not any(word in file.read_text() for word in words), file
    assert {file.suffix for file in CONFIGS.iterdir()} == {".yaml", ".npz"}
    for file in CONFIGS.glob("rig_*.yaml"):
        assert not any(word in file.read_text() for word in ("report_noise_rms", "innovation_std", "alike"))


@pytest.mark.parametrize("name", ["rig_01", "rig_05"])
def test_one_that_lacks_something_and_one_that_does_not(name):
    found = outcome(name)
    assert found.outcome == "right"
    assert found.over < 1.05


@pytest.mark.slow
def test_all_of_them():
    found = {name: outcome(name) for name in STUDIES}
    print(Counter(each.outcome for each in found.values()))
    assert {name: each.outcome for name, each in found.items() if each.outcome not in ("right", "equivalent")} == {}
