"""The commands of the workflow file are those of the command line, and its noise sweep passes its gate."""

import os
import shlex
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

ROOT = Path(__file__).parents[1]
WORKFLOW = yaml.safe_load((ROOT / ".github" / "workflows" / "whid.yml").read_text())
STEPS = [step["run"] for step in WORKFLOW["jobs"]["test"]["steps"] if "run" in step]


def gate(folder, *more):
    """Run the workflow's sweep line in a folder that has the configs, as the job does after its install line."""
    (line,) = [line for line in STEPS if "whid sweep" in line]
    words = shlex.split(line)
    assert words[0] == ".venv/bin/whid"
    (folder / "configs").symlink_to(ROOT / "configs")
    page = folder / "page.md"
    env = {**os.environ, "PYTHONPATH": str(ROOT), "GITHUB_STEP_SUMMARY": str(page)}
    run = subprocess.run(
        [sys.executable, "-m", "whid", *words[1:], *more], cwd=folder, env=env, capture_output=True, text=True
    )  # fmt: skip
    return run, page, folder / words[words.index("--junit") + 1]


def judged(run, page, junit):
    assert run.returncode == 0, run.stderr
    text = page.read_text()
    assert "brouri2019-noise: passed" in text
    assert "front.gain.error.max, 0.95 quantile" in text
    cases = ElementTree.parse(junit).getroot()
    assert cases.get("failures") == "0"
    assert len(cases) == 3


def test_the_noise_gate_on_a_small_count(tmp_path):
    judged(*gate(tmp_path, "--set", "sweep.repeats=2", "--set", "sweep.over={plant.noise.std: [0.5, 2.0]}"))


@pytest.mark.slow
def test_the_noise_gate_exactly_as_the_job_runs_it(tmp_path):
    judged(*gate(tmp_path))


@pytest.mark.slow
def test_the_tables_are_as_expected_as_the_job_checks_them(tmp_path):
    (line,) = [line for line in STEPS if "whid table" in line]
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    command = [sys.executable, "-m", "whid", *shlex.split(line)[1:]]
    run = subprocess.run(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


def test_a_breached_bound_is_a_failure_for_the_job(tmp_path):
    run, page, junit = gate(
        tmp_path, "--set", "sweep.repeats=1", "--set", "sweep.over={plant.noise.std: [0.5]}",
        "--set", "expect=[{metric: front.gain.error.max, below: 1e-9}, {metric: nothing, below: 1}]",
    )  # fmt: skip
    assert run.returncode == 4
    assert "a bound is breached" in page.read_text()
    cases = ElementTree.parse(junit).getroot()
    assert (cases.get("failures"), cases.get("errors")) == ("1", "1")
