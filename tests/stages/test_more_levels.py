"""Levels that pieces lack, and the error of f that they promise."""

import numpy as np
import pytest

from whid.stages.levels import level_means
from whid.stages.more_levels import lobatto, more_levels
from whid.stages.segmentation import segment


def curve(u, f, std=0.05, seed=62000, samples=400):
    rng = np.random.default_rng(seed)
    return level_means([f(v) + std * rng.normal(size=samples) for v in u], u, np.ones(len(u)), 1.0, 0.0)


def step(v):
    return np.where(v < 0.7, 1.0 + v, 4.0 - v)


def test_lobatto_nodes_integrate_polynomials_of_degree_2n_minus_3():
    x = lobatto(6)
    weights = np.linalg.solve(np.vander(x, increasing=True).T, [2 / (k + 1) * (k % 2 == 0) for k in range(6)])
    for k in range(10):  # the weights that integrate up to 5 integrate up to 9 at these nodes only
        assert weights @ x**k == pytest.approx(2 / (k + 1) * (k % 2 == 0), abs=1e-12)


def test_pieces_with_levels_enough_are_left_alone():
    found = curve(np.linspace(-2.0, 2.0, 41), step)
    assert len(more_levels(segment(found), found.level, 0.003, 3).level) == 0


def test_levels_that_crowd_at_a_border_count_as_one():
    crowded = np.array([-2.0, 1.9, 1.95, 1.98, 1.99, 2.0])
    found = curve(crowded, lambda v: 1.0 + v)
    np.testing.assert_allclose(more_levels(segment(found, max_degree=1), found.level, 0.003, 3).level, 2 * lobatto(5)[1:-1])


def test_the_error_of_a_new_level_is_that_of_the_fit_with_it():
    """Levels −1, 0, 1 of a line and two more, all of one error: (1/n + x²/Σx²)·std², by hand."""
    found = curve(np.array([-1.0, 0.0, 1.0]), lambda v: 2 * v)
    std = float(found.mean_std[0])
    found = found._replace(mean_std=np.full(3, std))
    level, error = more_levels(segment(found, max_degree=1), found.level, std, 4)
    x = lobatto(6)[1:-1]
    np.testing.assert_allclose(level, x, atol=1e-12)
    np.testing.assert_allclose((error / std) ** 2, 1 / 7 + x**2 / (2 + x @ x), rtol=1e-6)
