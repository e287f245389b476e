"""What a whole run costs: seconds from cold for the starter, memory for ten million samples."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MEASURE = """
import resource, sys
from whid import flow
result = flow.run(sys.argv[1], sys.argv[2], max_memory=2e9)
assert result.error is None, result.error
print(sum(map(len, result.records)), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)  # Linux: kB
"""
BIG = """
name: big
plant:
  chain:
    - {kind: linear, num: [0.04], den: [1, 0.5, 0.04]}
    - {kind: piecewise, breaks: [-0.8, 0.8], pieces: [[-50, 62.5], [0], [-25, 0, 31.25]]}
    - {kind: linear, num: [0.1], den: [1, 0.7, 0.1]}
  noise: {kind: white, std: 0.5}
experiment:
  dt: 0.5235987755982988
  parts:
    - {kind: staircase, from: -3.5, to: 3.0, step: 0.5, hold_s: 116000, return: true}
    - {kind: sine, offset: 2.0, amplitude: 1.0, samples_per_period: [600, 300, 200], periods: 3000}
    - {kind: hold, level: 1.7, hold_s: 400000, use: report}
identify: {kind: wiener_hammerstein}
"""


@pytest.mark.slow
def test_the_starter_takes_six_seconds_from_cold(tmp_path):
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "whid",
            "run",
            str(ROOT / "configs/starter.yaml"),
            "--out",
            str(tmp_path),
            "--force",
        ]
        subprocess.run(command, check=True, capture_output=True)
        seconds.append(time.perf_counter() - start)
    print(f"starter: median {statistics.median(seconds):.2f} s of {[round(s, 2) for s in seconds]}")
    assert statistics.median(seconds) <= 6.0


@pytest.mark.slow
def test_ten_million_samples_fit_into_two_gigabytes(tmp_path):
    config = tmp_path / "big.yaml"
    config.write_text(BIG)
    command = [sys.executable, "-c", MEASURE, str(config), str(tmp_path / "runs")]
    samples, gigabytes = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    print(f"{samples} samples: {float(gigabytes):.2f} GB")
    assert int(samples) >= 10_000_000
    assert float(gigabytes) <= 2.0
