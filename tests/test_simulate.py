"""The simulator's draws, sizes and splits; its accuracy is bar A1's business."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.design_p import PLAN, PLANT
from whid import predict
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.disturbances.process import Process
from whid.disturbances.white import White
from whid.experiments._experiment import Experiment
from whid.experiments.hold import Hold
from whid.experiments.sine import Sine
from whid.simulate import simulate
from whid.system import System


def test_design_p_has_the_length_of_the_paper():
    assert PLAN.samples() == 29212
    parts = PLAN.plan()
    assert [p.kind for p in parts] == ["hold"] * 16 + ["sine"] * 3
    assert all(a.stop == b.start for a, b in pairwise(parts))


def test_noise_of_one_size_is_the_same_draw_scaled():
    quiet = simulate(PLANT, PLAN, np.random.default_rng(1)).y
    one, two = (simulate(replace(PLANT, noise=(White(std=s),)), PLAN, np.random.default_rng(1)).y for s in (0.5, 1.0))
    assert np.allclose(2 * (one - quiet), two - quiet, atol=1e-9)
    n = len(quiet)
    assert abs(np.std(one - quiet) - 0.5) < 4 * 0.5 / np.sqrt(2 * n)


def test_snr_sets_the_ratio_of_variances():
    quiet = simulate(PLANT, PLAN, np.random.default_rng(1)).y
    noisy = simulate(replace(PLANT, noise=(White(snr_db=20.0),)), PLAN, np.random.default_rng(1)).y
    assert abs(10 * np.log10(np.var(quiet) / np.var(noisy - quiet)) - 20) < 4 * 4.34 * np.sqrt(2 / len(quiet))


def test_process_noise_passes_the_nonlinearity_and_the_back_block():
    """Ahead of a gain of 3 and a lag, held white noise of variance σ² leaves with 9σ²(1−a)/(1+a), a = e^(−h/τ)."""
    plant = System(
        chain=(Linear(num=(1.0,), den=(0.5, 1.0)), Polynomial(coefficients=(0.0, 3.0)), Linear(num=(1.0,), den=(0.2, 1.0))),
        noise=(Process(std=0.3),),
    )
    y = simulate(
        plant, Experiment(dt=0.1, initial="steady", parts=(Hold(level=1.0, hold_s=4000.0),)), np.random.default_rng(5)
    ).y
    a = np.exp(-0.1 / 0.2)
    expected = 9 * 0.3**2 * (1 - a) / (1 + a)
    effective = len(y) * (1 - a**2) / (1 + a**2)
    assert abs(np.var(y) / expected - 1) < 4 * np.sqrt(2 / effective)
    assert abs(y.mean() - 3.0) < 4 * 3 * 0.3 / np.sqrt(len(y))


def test_steady_start_does_not_move():
    y = simulate(PLANT, replace(PLAN, initial="steady", parts=(Hold(level=2.0, hold_s=50.0),)), np.random.default_rng(0)).y
    assert np.allclose(y, 100.0, atol=1e-9)


@pytest.mark.parametrize("intersample", ["zoh", "foh", "bandlimited", "discrete"])
def test_chunks_do_not_show(intersample, monkeypatch):
    plan = replace(
        PLAN, intersample=intersample, parts=(Sine(offset=1.0, amplitude=3.0, samples_per_period=70.0, periods=12),)
    )
    whole = simulate(PLANT, plan, np.random.default_rng(0)).y
    monkeypatch.setattr(predict, "CHUNK", 101)
    assert np.allclose(simulate(PLANT, plan, np.random.default_rng(0)).y, whole, rtol=0, atol=1e-10 * np.abs(whole).max())


def test_the_exact_path_is_the_limit_of_the_sampled_one():
    """The sampled path on a grid ten times finer comes ten times nearer: its error is the inner hold, O(h)."""
    plan = replace(PLAN, parts=(Sine(offset=2.0, amplitude=1.0, samples_per_period=100.0, periods=6),))
    exact = simulate(PLANT, plan, np.random.default_rng(0)).y
    errors = []
    for fold in (1, 10, 100):
        fine = np.repeat(simulate(PLANT, plan, np.random.default_rng(0)).u, fold)
        errors.append(np.abs(PLANT.tree(fine, plan.dt / fold, "discrete")[::fold] - exact)[300:].max())
    assert 7 < errors[0] / errors[1] < 13
    assert 7 < errors[1] / errors[2] < 13
