"""Every picture in the folder draws what it claims, from what is there, on what it needs."""

from __future__ import annotations

import importlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from scipy.signal import freqz, lfilter

from tests.small_study import PLANT, small_study
from whid import flow, plots
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.fit import linear_least_squares
from whid.methods.wiener_hammerstein import WienerHammerstein
from whid.plots import _style, _system
from whid.plots.best_linear import _db, response
from whid.plots.sine_periods import _fold
from whid.stages.best_linear import realisations
from whid.stages.linear_fit import linear_fit
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


def multisines(curved):
    """Six realisations of four periods through a filter and a cubic, with noise; their best linear approximation."""
    rng, lines = np.random.default_rng(3), np.arange(1, 60)
    periods = []
    for _ in range(6):
        spectrum = np.zeros(129, complex)
        spectrum[lines] = 40 * np.exp(2j * np.pi * rng.random(len(lines)))
        u = np.tile(np.fft.irfft(spectrum, 256), 4)
        y = lfilter([0.2], [1.0, -0.8], np.tile(u, 2))[len(u) :]
        y = y + curved * y**3 + 1e-3 * rng.normal(size=len(u))
        periods.append((u.reshape(4, 256), y.reshape(4, 256)))
    bla = realisations(periods, 0.1)
    return {"best_linear": bla, "linear_fit": linear_fit(bla, [1], rng, zeros=[0])}


def test_the_levels_of_noise_and_distortion_stand_below_the_gain(run, tmp_path):
    for curved, said in ((0.3, "dB above noise"), (0.0, "dB below noise")):
        found = multisines(curved)
        figure = drawn("best_linear", replace(run, stages=found))
        lines = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines}
        bla, level = found["best_linear"], lines["standard error: noise and distortion"]
        np.testing.assert_allclose(level, 10 * np.log10(2 * bla.std**2))
        expected = 20 * np.log10(1e-3 / np.sqrt(4 * 6) * np.sqrt(256) / 40)  # white noise over 24 periods, at |U| = 40
        assert np.median(lines["of it noise"]) == pytest.approx(expected, abs=1)
        above = np.median(level - lines["of it noise"])
        assert above > 10 if curved else abs(above) < 2
        assert said in figure.axes[0].texts[0].get_text()
        np.testing.assert_allclose(lines["rational fit, poles: 1"], _db(np.abs(response(found["linear_fit"], bla.omega))))
    names, faults = plots.draw(replace(run, stages=found, residuals=()), tmp_path)
    assert "best_linear.png" in names
    assert faults == ()


def test_without_realisations_there_is_one_level(run):
    bla = multisines(0.3)["best_linear"]
    figure = drawn("best_linear", replace(run, stages={"best_linear": bla._replace(noise=np.full(len(bla.omega), np.nan))}))
    assert [line.get_label() for line in figure.axes[0].lines] == ["best linear approximation", "standard error"]


def test_a_rational_fit_has_the_response_of_its_filter():
    fit = SimpleNamespace(gain=1.5, zeros=np.array([0.3]), poles=np.array([0.8, 0.5 + 0.3j, 0.5 - 0.3j]), dt=0.1)
    omega = np.array([0.1, 3.0, 20.0])
    den = np.real(np.poly(fit.poles))
    num = np.poly(fit.zeros) * 1.5 * den.sum() / np.poly(fit.zeros).sum()
    np.testing.assert_allclose(response(fit, omega), freqz(num, den, omega * 0.1)[1])


def test_a_ranking_without_gains_shows_its_numbers():
    from types import SimpleNamespace

    from matplotlib.figure import Figure

    from whid.plots import trace_ranking

    ranking = SimpleNamespace(
        effect=("a", "b"), gain=np.full(2, np.nan), screened=np.array([-3.5, 40.0]), taken="", needed=10.0
    )
    figure = Figure()
    trace_ranking.draw(SimpleNamespace(stages={"ranking": ranking}), figure)
    assert [text.get_text() for text in figure.axes[0].texts] == ["-3.5"]
