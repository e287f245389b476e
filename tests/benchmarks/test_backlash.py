"""Bar D1: a million samples through a backlash in half a second."""

import time

import numpy as np
import pytest

from whid.blocks.backlash import Backlash

BORDERS = {
    "gear": ((-0.15, 1.0, 0.0, 0.05), (0.15, 1.0, 0.0, 0.05)),
    "crossing": ((-0.3, 0.7, 0.8, -0.8), (-0.2, 0.7, 0.7, -0.1)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BORDERS)
@pytest.mark.parametrize("wave", ["sine", "noise"])
def test_bar_d1_half_a_second_for_a_million_samples(name, wave):
    n = 1_000_000
    x = 1.3 * np.sin(0.06 * np.arange(n)) if wave == "sine" else np.random.default_rng(5).normal(size=n)
    block, taken = Backlash(rising=BORDERS[name][0], falling=BORDERS[name][1]), []
    for _ in range(5):
        start = time.process_time()
        block(x, 1.0, "discrete")
        taken.append(time.process_time() - start)
    print(f"D1 {name}, {wave}: {np.median(taken):.3f} s CPU for 1e6 samples")
    assert np.median(taken) <= 0.5
