"""What sweeps cost, in CPU seconds: `pytest -s -m slow tests/benchmarks/test_sweep.py` prints figures beside their bars."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager

import control
import numpy as np
import pytest
import yaml

from tests import design_p
from tests.test_sweep import STUDY
from whid import sweep as sweeps
from whid.disturbances.white import White
from whid.engine import Group, processes
from whid.methods.wiener_hammerstein import WienerHammerstein
from whid.simulate import Clean, simulate
from whid.sweep import sweep
from whid.system import System

pytestmark = pytest.mark.slow
NOISE = "configs/brouri2019/noise-sweep.yaml"  # Table 4.1's plant and plan: 5 levels, 29 212 samples
FULL = "sweep.full_records=true"


def cpu(run, repeats=5):
    """Median CPU seconds of five, after one to warm up."""
    run()
    taken = []
    for _ in range(repeats):
        began = time.process_time()
        run()
        taken.append(time.process_time() - began)
    return float(np.median(taken))


@contextmanager
def clock(read=time.process_time):
    seconds = []
    began = read()
    yield seconds
    seconds.append(read() - began)


@pytest.fixture(autouse=True)
def without_pictures(monkeypatch):
    monkeypatch.setattr(sweeps.plots, "draw", lambda found, folder: ((), ()))


def load():
    return f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


def test_a_further_noisy_repeat_against_control():
    plant, clean = System(chain=design_p.PLANT.chain, noise=(White(std=0.5),)), Clean()
    plan, rng = design_p.PLAN.plan(), np.random.default_rng(1)
    ours = cpu(lambda: simulate(plant, design_p.PLAN, rng, plan, clean)) / len(design_p.clean())
    u = design_p.clean().u[:20_000]
    t = design_p.PLAN.dt * np.arange(len(u))
    front, back = (plant.chain[k].control() for k in (0, 2))

    def chain():
        v = control.forced_response(front, t, u).outputs
        control.forced_response(back, t, plant.chain[1].value(v))

    theirs = cpu(chain) / len(u)
    print(
        f"\nnoisy repeat: {ours * 1e9:.0f} ns a sample, control {theirs * 1e9:.0f}: {theirs / ours:.0f}x (bar 300), {load()}"
    )
    assert theirs / ours >= 300


def test_staged_identification():
    method = WienerHammerstein(whole_record=False)
    records = iter([design_p.record(82_000 + k) for k in range(6)])
    seconds = cpu(lambda: list(method([next(records)])))
    print(f"\nstaged identification of 29 212 samples: {seconds * 1e3:.0f} ms (bar 60), {load()}")
    assert seconds <= 0.060


@pytest.mark.parametrize(("how", "override", "bar"), [("drawn", "seed=82100", 25), ("full", FULL, 90)])
def test_a_noise_sweep_on_one_core(how, override, bar, tmp_path):
    with clock() as taken:
        found = sweep(NOISE, tmp_path, ["sweep.repeats=200", override])
    assert found.failed == 0
    assert (found.records[0] == "") is (how == "drawn")
    print(f"\nnoise sweep of 5 x 200, {how}: {taken[0]:.1f} s (bar {bar}), {load()}")
    assert taken[0] <= bar


def test_two_workers_against_one(tmp_path):
    """Wall time, on full records; the start of the processes counts."""
    seconds, found = [], []
    for jobs in (1, 2):
        with clock(time.perf_counter) as taken:
            found.append(sweep(NOISE, tmp_path / str(jobs), ["sweep.repeats=200", FULL], jobs=jobs))
        seconds += taken
    one, two = seconds
    assert all(np.array_equal(values, found[1].values[name], equal_nan=True) for name, values in found[0].values.items())
    print(f"\none worker {one:.1f} s, two {two:.1f}: {one / two:.2f}x (bar 1.8), {load()}")
    assert one / two >= 1.8


def work(shared, tasks):
    """Wait for every task, and tell how long that was."""
    seconds = []
    for _ in tasks:
        with clock(time.perf_counter) as taken:
            time.sleep(shared)
        seconds += taken
    return seconds


@pytest.mark.parametrize(("groups", "tasks", "seconds"), [(400, 1, 0.015), (40, 20, 0.03)])
def test_handing_work_over_costs_little(groups, tasks, seconds):
    """What two workers do besides waiting for their tasks, from the first outcome to the last but one."""
    ends, busy = [], []
    for _, _, waited in processes(2)(work, [Group(seconds, tuple(range(tasks)))] * groups):
        ends.append(time.perf_counter())
        busy.append(sum(waited))
    overhead = 1 - sum(busy[1:-1]) / (2 * (ends[-2] - ends[0]))
    print(f"\n{groups} groups of {tasks}, {len(busy)} batches: {overhead:.1%} of two workers' time is no work (bar 5 %)")
    assert overhead <= 0.05


def test_cost_grows_with_the_cells(tmp_path):
    """Cells of one repeat each, drawn: what a cell costs beside its identification shows."""
    figures = {}
    for cells in (1, 100, 1000, 10_000):  # the first pays for the imports
        study = yaml.safe_load(STUDY.replace("whole_record: false", "whole_record: false, settle_s: 3"))
        values = np.linspace(0.01, 0.05, cells).tolist()
        study["sweep"] = {"over": {"plant.noise.std": values}, "repeats": 1}
        with clock() as taken:
            found = sweep(study, tmp_path / str(cells))
        with clock() as table:
            found.table()
        size = sum(file.stat().st_size for file in found.path.glob("sweep.h5"))
        figures[cells] = taken[0] / cells, size / cells, table[0]
        print(
            f"\n{cells} cells: {taken[0] / cells * 1e3:.1f} ms a cell, {size / cells:.0f} bytes a cell in sweep.h5, table "
            f"{table[0]:.2f} s, {found.failed} failed, {load()}"
        )
    assert 0.8 <= figures[10_000][0] / figures[100][0] <= 1.2
    assert figures[10_000][1] <= 1.2 * figures[1000][1]
    assert figures[10_000][2] <= 2.0
