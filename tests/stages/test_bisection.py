"""Levels in gaps and on sparse pieces, frequencies that connect."""

import numpy as np

from whid.stages.bisection import side, wide
from whid.stages.levels import level_means
from whid.stages.segmentation import segment


def curve(u, f, std=0.05, seed=62000, samples=400):
    rng = np.random.default_rng(seed)
    return level_means([f(v) + std * rng.normal(size=samples) for v in u], u, np.ones(len(u)), 1.0, 0.0)


def step(v):
    return np.where(v < 0.7, 1.0 + v, 4.0 - v)


U = np.arange(-2.0, 2.5, 0.5)


def test_a_level_in_the_gap_is_given_to_its_piece_or_to_none():
    pieces = segment(curve(U, step))
    assert [side(pieces, 0, v, float(step(v)), 0.003) for v in (0.55, 0.9)] == [-1, 1]
    assert side(pieces, 0, 0.75, 2.5, 0.003) == 0  # neither piece is there
    assert side(pieces, 0, 0.75, 1.75, 2.0) == 0  # too noisy to tell


def test_kinks_are_asked_about_only_where_a_jump_could_hide():
    bent = segment(curve(U, lambda v: np.maximum(v - 0.7, 0.0)))
    assert bent.jump.tolist() == [False]
    assert wide(bent, 4.0, 1e-3) == [0]
    assert wide(bent, 4.0, 10.0) == []
    assert wide(segment(curve(U, step)), 4.0, 10.0) == [0]  # a jump always
    narrow = np.array([-2.0, -1.0, 0.0, 0.698, 0.702, 1.0, 2.0])
    assert wide(segment(curve(narrow, step)), 4.0, 1e-3) == []
