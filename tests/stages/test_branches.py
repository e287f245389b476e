"""Up against down: size of the test, a true gap, drift, and the measured rig whose branches must not be called memory."""

import numpy as np
import pytest

from tests.stages.curves import curve_of, measured_staircase
from whid.stages.branches import branch_gap
from whid.stages.levels import level_means
from whid.stages.settle import settle_time

LEVEL = np.append(np.arange(0, 11.0), np.arange(9.0, -1, -1))
WAY = np.append(np.ones(11), -np.ones(10))


def test_size_and_family_wise_marks():
    """4000 memory-free staircases at nominal .01: both figures within 3 binomial deviations."""
    rng = np.random.default_rng(31)
    found = [branch_gap(curve_of(LEVEL, LEVEL + 0.1 * rng.normal(size=21), 0.1, WAY), settled_within=0) for _ in range(4000)]
    size, marks = np.mean([f.memory for f in found]), np.mean([f.significant.any() for f in found])
    print(f"branch gap: size {size:.4f}, family-wise marks {marks:.4f}, nominal .01")
    assert size == pytest.approx(0.01, abs=0.005)
    assert marks == pytest.approx(0.01, abs=0.005)


def test_a_backlash_is_memory():
    found = branch_gap(curve_of(LEVEL, LEVEL - 0.4 * (WAY < 0) + 0.1 * np.random.default_rng(0).normal(size=21), 0.1, WAY))
    assert found.memory
    assert found.level.tolist() == list(range(10))  # the turning point is reached one way only
    assert found.gap == pytest.approx(np.full(10, 0.4), abs=4 * 0.1 * np.sqrt(2))
    assert found.gap_std == pytest.approx(np.full(10, 0.1 * np.sqrt(2)))
    assert found.table().notes[-1] == "memory, or a drift"
    assert "second staircase" in found.doubts()[0]


def test_a_gap_within_the_settling_band_is_reported_but_not_claimed():
    found = branch_gap(curve_of(LEVEL, LEVEL - 0.1 * (WAY < 0), 0.01, WAY))
    assert found.p < 1e-6
    assert found.share == pytest.approx(0.1 / 10.1)
    assert not found.memory


def test_repeated_visits_combine_and_their_scatter_counts():
    rng = np.random.default_rng(5)
    level, way = np.tile(LEVEL, 4), np.tile(WAY, 4)
    quiet = branch_gap(curve_of(level, level + 0.1 * rng.normal(size=84), 0.1, way))
    assert quiet.gap_std[1:] == pytest.approx(np.full(9, 0.1 / np.sqrt(2)))  # four visits a side
    drifting = branch_gap(curve_of(level, level + np.repeat(rng.normal(size=4), 21), 0.1, way))
    assert not drifting.memory
    assert np.all(drifting.gap_std > 0.3)


def test_upward_only_sees_nothing():
    found = branch_gap(curve_of(np.arange(5.0), np.arange(5.0), 0.1, np.ones(5)))
    assert found.dof == 0
    assert not found.memory
    assert "cannot be seen" in found.table().notes[0]


def test_measured_rig_has_no_memory():
    """The hoop's branches agree within 0.22 V of 20 V; with 5 s holds its 1.2 s lag is not settled, which opens a gap."""
    holds, level, way = measured_staircase()
    settle = settle_time(holds, 0.1)
    curve = level_means(holds, level, way, 0.1, settle.settle)
    found = branch_gap(curve)
    print(found.table().notes, settle.table().notes)
    assert not settle.reached
    assert curve.drifting.any()
    assert len(found.level) == 19
    assert found.largest <= 0.22
    assert not found.memory
