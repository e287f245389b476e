"""Static curves for the tests: made up, or from the measured staircase."""

import gzip

import numpy as np

from tests.measured_data import measured
from whid.stages.levels import StaticCurve


def curve_of(level, mean, std, direction=None):
    n = len(level)
    way = np.ones(n) if direction is None else direction
    return StaticCurve(
        np.asarray(level, float), np.asarray(mean, float), np.full(n, float(std)), way, np.full(n, 100), 0.0, 1.0,
        np.empty(0), 1.0, True, 0.0, np.zeros(n, bool),
    )  # fmt: skip


def measured_staircase():
    """Holds, levels and directions of the hoop's staircase."""
    with gzip.open(measured("ball_and_hoop_staircase.csv.gz")) as file:
        _, u, y = np.loadtxt(file, delimiter=",", skiprows=1, unpack=True)
    edges = np.flatnonzero(np.abs(np.diff(u)) > 0.02) + 1
    level = u[np.append(0, edges)]
    return np.split(y, edges), level, np.append(1.0, np.sign(np.diff(level)))
