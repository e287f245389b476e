"""Every picture in the folder draws what it claims, from what is there, on what it needs."""

from __future__ import annotations

import importlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from tests.small_study import PLANT, small_study
from whid import flow, plots
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.fit import linear_least_squares
from whid.methods.wiener_hammerstein import WienerHammerstein
from whid.plots import _style, _system
from whid.plots.sine_periods import _fold
from whid.system import System

PICTURES = ("frequency_response", "residual", "sine_periods", "static_curve")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
        return flow.run(small_study(identify=WienerHammerstein()), tmp_path_factory.mktemp("run"))


def drawn(name: str, run) -> Figure:
    figure = Figure()
    importlib.import_module(f"whid.plots.{name}").draw(run, figure)
    return figure


def test_all_pictures_are_drawn_and_are_pictures(run, tmp_path):
    names, faults = plots.draw(run, tmp_path)
    assert faults == ()
    assert set(names) == {f"{name}.png" for name in PICTURES}
    for name in names:
        pixels = imread(tmp_path / name)
        assert pixels.shape[1] > 700
        assert 0.005 < np.mean(pixels[..., :3].min(axis=2) < 0.8) < 0.5  # neither empty nor full


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_whose_needs_are_absent_is_not_drawn(run, tmp_path, name):
    needs = importlib.import_module(f"whid.plots.{name}").NEEDS
    bare = replace(run, stages={}, residuals=(), truth=None, records=(replace(run.records[0], parts=()),))
    assert any(not plots.has(bare, need) for need in needs)
    assert plots.draw(bare, tmp_path) == ((), ())


@pytest.mark.parametrize("name", PICTURES)
def test_axes_are_labelled(run, name):
    axes = [ax for ax in drawn(name, run).axes if ax.lines]
    assert all(any(a.get_xlabel() for a in ax.get_shared_x_axes().get_siblings(ax)) or ax.get_xlabel() for ax in axes[-1:])
    assert any(ax.get_ylabel() for ax in axes)


def test_units_stand_on_the_axes(run):
    measured = replace(run, records=tuple(replace(r, units={"input": "V", "output": "m/s"}) for r in run.records))
    labels = {ax.get_ylabel() for ax in drawn("static_curve", measured).axes} | {
        ax.get_xlabel() for ax in drawn("static_curve", measured).axes
    }
    assert {"steady output, m/s", "input level, V"} <= labels


def test_truth_is_drawn_only_where_there_is_one(run):
    def legend(result):
        return [text.get_text() for text in drawn("static_curve", result).axes[0].get_legend().get_texts()]

    assert "truth" in legend(run)
    assert "truth" not in legend(replace(run, truth=None))
    assert {"upward", "downward"} <= set(legend(run))


def test_the_static_picture_holds_the_levels_and_the_true_curve(run):
    above = drawn("static_curve", run).axes[0]
    truth = next(line for line in above.lines if line.get_label() == "truth")
    u, y = truth.get_data()
    expected = np.where(u > 0.5, u - 0.5, np.where(u < -0.5, u + 0.5, 0.0))  # both linear blocks have gain 1
    np.testing.assert_allclose(y, expected, atol=1e-12)


def test_a_jump_has_no_vertical_stroke():
    system = System(chain=(Linear(num=(2.0,), den=(1.0, 1.0)), Piecewise(breaks=(1.0,), pieces=((0.0,), (5.0,)))))
    assert _system.jump_levels(system) == pytest.approx([0.5])  # v = 2u
    assert list(_system.steady_curve(system, np.array([0.4, 0.6]), 0.1)) == [0.0, 5.0]


def test_the_band_is_the_first_order_propagation_of_the_covariance():
    # G = 1/(a s + 1): d log G/da = −s/(a s + 1), so the band is that times the standard error of a
    lag = System(chain=(Linear(num=(1.0,), den=(0.5, 1.0), fix=("num",)),))
    estimate = linear_least_squares(np.eye(1), np.array([0.5]), np.array([1 / 0.02]), ("chain.0.den.0",))
    omega = np.array([0.3, 2.0, 9.0])
    model = SimpleNamespace(system=lag, estimate=estimate)
    response, std = _system.gain_and_band(model, [0], omega)
    slope = 0.02 * -1j * omega / (0.5j * omega + 1)
    np.testing.assert_allclose(response, 1 / (0.5j * omega + 1))
    np.testing.assert_allclose(std, np.abs([slope.real, slope.imag]), rtol=1e-4)


def test_the_linear_blocks_are_those_before_and_behind_the_nonlinearity():
    assert (_system.linear_blocks(PLANT, "front"), _system.linear_blocks(PLANT, "back")) == ([0], [2])
    assert _system.linear_blocks(System(chain=PLANT.chain[:2]), "back") == []


@pytest.mark.parametrize("period", [50.0, 50.25, 1000.0])
def test_folding_a_sine_gives_the_sine(period):
    n = np.arange(int(8 * period))
    y = np.sin(2 * np.pi * n / period)
    fold = _fold(y, np.zeros(len(y)), period, "")
    np.testing.assert_allclose(fold.mean, np.sin(2 * np.pi * fold.phase), atol=2e-3)
    np.testing.assert_allclose(fold.model, fold.mean)


def test_a_long_signal_keeps_its_extremes():
    y = np.zeros(100_000)
    y[77_777] = 9.0
    y[:40_000] = np.nan
    x, line = _style.envelope(np.arange(len(y)), y)
    assert len(line) < 4 * _style.COLUMNS
    assert np.nanmax(line) == 9.0
    assert x[np.nanargmax(line)] == pytest.approx(77_777, abs=100)
    assert np.isnan(line[x < 39_000]).all()
