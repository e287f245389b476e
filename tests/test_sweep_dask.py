"""The same sweep on a real Dask cluster, workers killed on the way."""

import os
import signal
import threading
import time

import numpy as np
import pytest

from tests.test_sweep import STUDY
from whid.errors import WhidError
from whid.sweep import sweep

distributed = pytest.importorskip("distributed", reason="needs the extra whid[cluster]")


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(STUDY)
    return path


@pytest.mark.slow
def test_a_cluster_agrees_bit_for_bit_though_workers_are_killed(config, tmp_path):
    more = ["sweep.repeats=60"]
    serial = sweep(config, tmp_path / "a", more)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        stop, kills = threading.Event(), []

        def kill():
            rng = np.random.default_rng(8786)
            while not stop.wait(4.0) and len(kills) < 4:
                pids = [w.pid for w in cluster.workers.values() if getattr(w, "pid", None)]
                if pids:
                    os.kill(int(rng.choice(pids)), signal.SIGKILL)
                    kills.append(time.time())

        killer = threading.Thread(target=kill)
        killer.start()
        found = sweep(config, tmp_path / "b", more, scheduler=cluster.scheduler_address)
        stop.set()
        killer.join()
    print(f"{len(kills)} workers killed, {found.failed} repeats failed")
    assert found.failed == 0
    assert all(np.array_equal(serial.values[name], found.values[name], equal_nan=True) for name in serial.values)


def test_no_scheduler_is_a_named_fault(config, tmp_path):
    with pytest.raises(WhidError, match="scheduler") as fault:
        sweep(config, tmp_path, scheduler="tcp://127.0.0.1:9")
    assert fault.value.code == "sweep-engine"
