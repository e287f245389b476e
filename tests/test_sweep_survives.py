"""A sweep that is interrupted, killed, refused or split among workers ends as one that was not."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.test_sweep import STUDY
from whid.cli import main
from whid.engine import DEATHS, Group, Lost, here, processes
from whid.errors import WhidError
from whid.files.journal import Journal, Outcome, progress
from whid.files.sweep_file import read_sweep
from whid.sweep import sweep

ROOT = Path(__file__).parents[1]


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(STUDY)
    return path


def start(config, out, *more):
    """The command as a user starts it, in a process of its own."""
    command = [sys.executable, "-m", "whid", "sweep", str(config), "--out", str(out), *more]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def finished(out):
    """How much of the sweep in a folder is kept, after it was interrupted, killed or done."""
    if done := next(out.glob("small-sweep-*/sweep.h5"), None):
        return next(iter(read_sweep(done)["values"].values())).size
    found = [progress(path) for path in out.glob("*.unfinished")]
    return found[0][0] if found and found[0] else 0


def killed(config, out, rng, *more):
    """Start the sweep and kill its whole process group, or one worker of it, at a random moment."""
    process = start(config, out, *more)
    time.sleep(rng.uniform(1.0, 5.0))
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def test_killed_at_random_and_resumed_agrees_bit_for_bit(config, tmp_path):
    more = "sweep.repeats=12"
    whole = sweep(config, tmp_path / "whole", [more])
    rng, before = np.random.default_rng(6), 0
    for _ in range(2):
        killed(config, tmp_path / "killed", rng, "--set", more)
        now = finished(tmp_path / "killed")
        assert now >= before
        before = now
    resumed = sweep(config, tmp_path / "killed", [more])
    assert all(np.array_equal(whole.values[name], resumed.values[name], equal_nan=True) for name in whole.values)
    assert not list((tmp_path / "killed").glob("*.unfinished"))


def test_only_what_is_missing_is_done(config, tmp_path):
    done, more = [], ["sweep.repeats=10"]
    with pytest.raises(KeyboardInterrupt):
        sweep(config, tmp_path, more, watch=lambda count, of, fault: done.append(count) if count < 4 else interrupt())
    kept = finished(tmp_path)
    assert 4 <= kept < 20  # whole batches
    again = []
    found = sweep(config, tmp_path, more, watch=lambda count, of, fault: again.append(count))
    assert again == list(range(kept + 1, 21))
    assert found.failed == 0


def interrupt():
    raise KeyboardInterrupt


def test_a_journal_of_something_else_is_refused(tmp_path):
    path = tmp_path / "a.unfinished"
    with Journal(path, "one", "name: a", 2) as journal:
        journal.add([((0, 1), Outcome({"m": (1.0, float("nan"))})), ((0, 0), Outcome({}, "why"))])
        with pytest.raises(WhidError, match="another process"):
            Journal(path, "one", "name: a", 2)
        assert progress(path) is None
    with pytest.raises(WhidError, match="another config"):
        Journal(path, "two", "name: b", 2)
    with Journal(path, "one", "name: a", 2) as journal:
        places, outcomes = zip(*journal.outcomes(), strict=True)
        assert places == ((0, 0), (0, 1))
        assert outcomes[0].error == "why"
        assert outcomes[1].metrics["m"][0] == 1.0
    assert progress(path) == (2, 2)
    path.write_bytes(b"no journal" * 1000)
    with pytest.raises(WhidError, match="journal"):
        progress(path)
    with pytest.raises(WhidError, match="journal"):
        Journal(path, "one", "name: a", 2)


def test_a_half_written_batch_leaves_nothing(tmp_path):
    path = tmp_path / "a.unfinished"
    with Journal(path, "one", "name: a", 2) as journal:
        journal.add([((0, 0), Outcome({}))])
        with pytest.raises((sqlite3.Error, TypeError)):
            journal.add([((0, 1), Outcome({})), ((1, object()), Outcome({}))])
        journal.file.execute("ROLLBACK")
    with Journal(path, "one", "name: a", 2) as journal:
        assert journal.places() == {(0, 0)}


def test_fail_fast_stops_and_the_rest_goes_on(config, tmp_path):
    args = [
        "sweep",
        str(config),
        "--out",
        str(tmp_path),
        "--json",
        "--set",
        "sweep.over={experiment.parts.0.hold_s: [0.2, 10]}",
    ]
    stopped = CliRunner().invoke(main, [*args, "--fail-fast"])
    assert stopped.exit_code == 3
    assert "sweep-failed" in stopped.stderr
    whole = CliRunner().invoke(main, args)
    assert whole.exit_code == 3
    report = json.loads(whole.stdout)
    assert report["failed"] == 3
    assert [(row["n"], "stage-too-short" in row["reason"]) for row in report["failures"]["rows"]] == [(3, True)]


def work(shared, tasks):
    """Double every task; the ones that shared names kill their process."""
    for task in tasks:
        if task in shared:
            os.kill(os.getpid(), signal.SIGKILL)
    return [2 * task for task in tasks]


def test_a_task_that_kills_its_worker_is_given_up_and_no_other():
    found = {}
    for _, tasks, outcomes in processes(2)(work, [Group((3,), tuple(range(6))), Group((), (10, 11))]):
        found |= dict(zip(tasks, outcomes, strict=True))
    assert isinstance(found.pop(3), Lost)
    assert DEATHS == 3
    assert found == {n: 2 * n for n in (0, 1, 2, 4, 5, 10, 11)}


def test_batches_grow_and_cover_every_task_once():
    done = [
        (group, task) for group, tasks, _ in here(work, [Group((), tuple(range(50))), Group((), (7,))]) for task in tasks
    ]
    assert done == [(0, n) for n in range(50)] + [(1, 7)]


@pytest.mark.slow
def test_fifty_kills_lose_nothing(config, tmp_path):
    """Parents and workers killed at random moments: what was finished stays, no file is ever broken."""
    whole = sweep(config, tmp_path / "whole", ["sweep.repeats=40"])
    rng, kills, out = np.random.default_rng(50), 0, tmp_path / "killed"
    while kills < 50:
        process, before = start(config, out, "--set", "sweep.repeats=40", "--jobs", "2"), finished(out)
        time.sleep(rng.uniform(1.0, 6.0))
        workers = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True).stdout.split()
        if rng.random() < 0.5 and workers:
            victim = int(rng.choice(workers))
            os.kill(victim, signal.SIGKILL)
            kills += 1
            time.sleep(rng.uniform(0.5, 2.0))
        if process.poll() is None:
            os.kill(process.pid, signal.SIGKILL)
            kills += 1
        process.wait()
        time.sleep(0.3)
        assert finished(out) >= before
        if done := next(out.glob("small-sweep-*/sweep.h5"), None):
            values = read_sweep(done)["values"]
            assert all(np.array_equal(whole.values[name], values[name], equal_nan=True) for name in values)
            out = tmp_path / f"killed{kills}"
    resumed = sweep(config, out, ["sweep.repeats=40"])
    assert all(np.array_equal(whole.values[name], resumed.values[name], equal_nan=True) for name in whole.values)
    print(f"{kills} kills: 0 finished cells lost, 0 corrupt files")
