"""`whid next`: the plan of a run goes into `experiment:` as it is."""

from dataclasses import replace

import pytest

from tests.small_study import EXPERIMENT, SmallStudy, small_study
from whid import flow
from whid.config.load import study_of
from whid.config.yaml import parse


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))


@pytest.fixture
def asked(tmp_path):
    """A run that may not experiment."""
    return flow.run(small_study(experiment=(replace(EXPERIMENT, adaptive=None),)), tmp_path / "runs").path


def test_the_plan_is_an_experiment_of_a_study_as_it_is(whid, asked, tmp_path):
    done = whid("next", asked, "--out", "plan.yaml")
    assert (done.exit_code, done.output) == (0, "plan.yaml\n")
    text = (tmp_path / "plan.yaml").read_text()
    assert "# 1. a level inside the dead zone" in text
    assert "predicted standard error: 0.01" in text
    assert whid("next", asked).output == text
    study = "name: rig\nidentify: {kind: wiener_hammerstein}\nplant: {chain: [{kind: dead_zone, low: -1, high: 1}]}\n"
    experiment = study_of(parse(study + text)).experiment[0]
    assert (experiment.dt, experiment.parts[0].level, experiment.parts[0].hold_s) == (0.05, 0.25, 5.0)
    again = whid("next", asked, "--out", "plan.yaml")
    assert again.exit_code == 2  # never overwritten
    assert (tmp_path / "plan.yaml").read_text() == text


def test_nothing_to_propose_is_said(whid, tmp_path):
    served = flow.run(small_study(), tmp_path / "runs").path
    done = whid("next", served)
    assert done.exit_code == 3
    assert "everything it asked for was performed" in done.stderr
    content = flow.run(small_study(identify=SmallStudy(wants=False)), tmp_path / "runs").path
    assert "it asked for nothing" in whid("next", content).stderr
