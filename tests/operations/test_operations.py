"""Each operation against an independent statement of what it should do; all of them against the contract of a kind."""

import numpy as np
import pytest
from scipy import signal

from whid.errors import WhidError
from whid.kinds import plain
from whid.operations._operation import Operation, Series, shrunk
from whid.operations.crop import Crop
from whid.operations.decimate import Decimate
from whid.operations.derivative import Derivative
from whid.operations.detrend import Detrend
from whid.operations.lag import Lag
from whid.operations.lowpass import Lowpass
from whid.operations.offset import Offset
from whid.operations.resample import Resample
from whid.operations.scale import Scale

EXAMPLES = {
    "crop": Crop(start=3, stop=300),
    "decimate": Decimate(factor=2),
    "derivative": Derivative(order=2, cutoff_hz=1.0),
    "detrend": Detrend(degree=2),
    "lag": Lag(column="input", samples=2),
    "lowpass": Lowpass(cutoff_hz=2.0),
    "offset": Offset(value=1.5, column="output"),
    "resample": Resample(dt=0.07),
    "scale": Scale(by="gain", column="input"),
}


def series(n=400, dt=0.1, missing=()):
    t = dt * np.arange(n)
    valid = np.ones(n, bool)
    valid[list(missing)] = False
    return Series(t, np.sin(t), np.cos(0.5 * t) + 2, valid)


@pytest.mark.parametrize("kind", Operation.kinds())
def test_contract(kind):
    assert kind in EXAMPLES, f"add an example of {kind} to EXAMPLES"
    operation = EXAMPLES[kind]
    before = series()
    copies = [column.copy() for column in before]
    after = operation.apply(before, {"gain": 2.0})
    assert len({len(column) for column in after}) == 1
    assert np.isfinite(after.input).all()
    assert np.all(np.diff(after.time) > 0)
    for column, copy in zip(before, copies, strict=True):
        np.testing.assert_array_equal(column, copy)  # the input is not changed
    keys = plain(operation)
    assert keys.pop("kind") == kind
    assert Operation.named(kind)(**keys) == operation
    assert Operation.named(kind).summary().endswith(".")


def test_column_operations_leave_the_other_column_alone():
    before = series()
    after = Offset(value=1.0, column="output").apply(before, {})
    np.testing.assert_array_equal(after.input, before.input)
    np.testing.assert_allclose(after.output, before.output + 1)


def test_scale_by_a_scalar_that_is_not_there():
    with pytest.raises(WhidError, match="gain, offset") as fault:
        Scale(by="gtau").apply(series(), {"gain": 1.0, "offset": 2.0})
    assert fault.value.code == "data-scalar"
    with pytest.raises(WhidError, match="exactly one"):
        Scale()


def test_lowpass_has_half_gain_at_the_cutoff_and_no_phase():
    n = np.arange(4000)
    x = np.cos(2 * np.pi * 1.0 * 0.1 * n)  # 1 Hz at 10 Hz
    y = Lowpass(cutoff_hz=1.0, order=3).values(x, 0.1, {})[1000:3000]
    line = np.exp(-2j * np.pi * 0.1 * n[1000:3000])
    gain = (y @ line) / (x[1000:3000] @ line)
    assert abs(gain - 0.5) < 1e-3


def test_lowpass_refuses_a_cutoff_at_half_the_rate():
    with pytest.raises(WhidError, match="half the sampling rate") as fault:
        Lowpass(cutoff_hz=5.0).values(np.zeros(100), 0.1, {})
    assert fault.value.code == "data-operation"


@pytest.mark.parametrize(("order", "bound"), [(1, 5e-4), (2, 5e-4)])
def test_derivative_of_a_sine(order, bound):
    dt, w = 0.01, 2 * np.pi * 8.0  # a twelfth of the sampling rate
    t = dt * np.arange(3000)
    inner = slice(300, -300)
    exact = w * np.cos(w * t) if order == 1 else -(w**2) * np.sin(w * t)
    found = Derivative(order=order).values(np.sin(w * t), dt, {})
    assert np.abs(found - exact)[inner].max() < bound * w**order
    smooth = Derivative(order=order, cutoff_hz=45.0).values(np.sin(w * t), dt, {})
    assert np.abs(smooth - exact)[inner].max() < 2e-3 * w**order


def test_derivative_below_the_cutoff_does_not_amplify_noise():
    noise = np.random.default_rng(3).standard_normal(20_000)
    dt, cutoff = 1e-3, 20.0
    found = Derivative(cutoff_hz=cutoff).values(noise, dt, {})
    b, a = signal.butter(4, 2 * cutoff * dt)
    w, h = signal.freqz(b, a, 8192)
    expected = np.sqrt(np.trapezoid((w / dt) ** 2 * np.abs(h) ** 4, w) / np.pi)  # white noise through jω|B|²
    assert found.std() == pytest.approx(expected, rel=0.1)


def test_decimate_removes_what_would_alias_and_keeps_the_rest():
    n = np.arange(8000)
    slow, fast = np.cos(2 * np.pi * n / 200), np.cos(2 * np.pi * n * 0.23)
    after = Decimate(factor=4).apply(Series(0.1 * n, slow + fast, slow, n >= 0), {})
    assert after.dt == pytest.approx(0.4)
    assert np.abs(after.input - slow[::4])[100:-100].max() < 0.02  # 0.05 dB ripple, forward and backward
    np.testing.assert_array_less(np.abs(after.input - after.output)[100:-100], 1e-3)
    with pytest.raises(WhidError, match="too few"):
        Decimate(factor=40).apply(series(100), {})


def test_resample_jittered_times_and_mark_holes():
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.8, 1.2, 500))
    t[250:] += 30.0
    before = Series(t, np.sin(0.05 * t), np.cos(0.05 * t), np.ones(500, bool))
    after = Resample(dt=1.0, output="cubic").apply(before, {})
    inside = after.valid
    assert np.abs(after.output - np.cos(0.05 * after.time))[inside].max() < 1e-4
    assert np.abs(after.input - np.sin(0.05 * after.time))[inside].max() < 1e-3  # chord error (0.05·1.2)²/8
    assert 28 <= int((~inside).sum()) <= 32
    assert np.all((after.time[~inside] > t[249]) & (after.time[~inside] < t[250]))


def test_resample_holds_a_held_input():
    t = np.array([0.0, 1.0, 2.0, 3.0])
    after = Resample(dt=0.5, input="hold").apply(Series(t, t**2, t, t >= 0), {})
    np.testing.assert_array_equal(after.input, [0, 0, 1, 1, 4, 4, 9])


def test_lag_shifts_and_cuts():
    n = np.arange(10.0)
    for column, k in (("input", 3), ("input", -3), ("output", 3), ("output", -3)):
        after = Lag(column=column, samples=k).apply(Series(n, n, n, n >= 0), {})
        moved, other = (after.input, after.output) if column == "input" else (after.output, after.input)
        assert len(after.time) == 7
        np.testing.assert_array_equal(moved, other - k)  # x[n − k]
        np.testing.assert_array_equal(after.time, other)


def test_detrend_takes_the_polynomial_only():
    t = np.linspace(0, 1, 501)
    wiggle = np.cos(2 * np.pi * 40 * t)
    left = Detrend(degree=2).values(3 + 2 * t - 5 * t**2 + wiggle, 0.01, {})
    assert np.abs(left - wiggle).max() < 0.02


def test_missing_samples_spread_by_the_filters_reach():
    before = series(missing=[200])
    after = Lowpass(cutoff_hz=1.0).apply(before, {})
    assert np.flatnonzero(~after.valid).tolist() == list(range(190, 211))
    assert shrunk(np.ones(5, bool), 3).all()


@pytest.mark.parametrize("seed", range(5))
def test_resample_finds_the_logger_s_step_under_jitter(seed):
    t = 0.05 * np.arange(6000) + 0.0025 * np.random.default_rng(seed).standard_normal(6000)
    after = Resample().apply(Series(t, t, t, t > -1), {})
    assert np.diff(after.time) == pytest.approx(0.05, abs=1e-12)
