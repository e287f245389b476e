"""Records simulated on the fly and not stored: peak memory, and CPU seconds against those of generating the samples."""

import os
import subprocess
import sys

import pytest

MEASURE = """
import resource, sys, time
import numpy as np
from whid import flow
from whid.config.load import load_study
from whid.simulate import stream
study = load_study(sys.argv[1])
record = stream(study.plant, study.experiment[0], np.random.default_rng(0))
began = time.process_time()
samples = sum(len(chunk.y) for chunk in record.chunks())
made = time.process_time()
result = flow.run(study, sys.argv[2], max_memory=2.5e8)
assert result.error is None, result.error
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3  # Linux: kB
print(samples, made - began, time.process_time() - made, peak)
"""
MEMORYLESS = """
name: long
plant:
  chain: [{{kind: polynomial, coefficients: [0, 0.5733, 0, 0, 0, 0.4267]}}]
  noise: {{kind: white, std: 0.1}}
experiment:
  dt: 1.0e-6
  parts:
    - {{kind: multisine, period: 1000000, periods: {periods}, lead_periods: 0, band: [0, 0.9], rms: 0.4}}
identify: {{kind: memoryless, domain: [-1, 1]}}
"""
MOST_MB, MOST_RATIO = 300, 3.0


def measured(config, tmp_path):
    """Samples, CPU seconds of generating, of the whole run, and its peak memory, MB."""
    file = tmp_path / "long.yaml"
    file.write_text(config)
    command = [sys.executable, "-c", MEASURE, str(file), str(tmp_path / "runs")]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    return [float(x) for x in done.stdout.split()]


@pytest.mark.slow
@pytest.mark.parametrize("periods", [10, 100, 1000])
def test_a_memoryless_record(tmp_path, periods):
    samples, made, ran, peak = measured(MEMORYLESS.format(periods=periods), tmp_path)
    print(f"{samples:.3g} samples: {peak:.0f} MB, generated in {made:.1f} s, run in {ran:.1f} s CPU: ratio {ran / made:.2f}")
    assert peak <= MOST_MB
    assert ran <= MOST_RATIO * made or samples < 1e8  # a short one is mostly pictures
