"""Parts found in an input against the plan that made it: exact, rounded, quantised, noisy."""

from itertools import pairwise

import numpy as np
import pytest

from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.stages._holds import least_bit
from whid.stages.find_parts import find_parts

DT = 0.5
PLANS = {
    "design P, up and down": (
        Staircase(from_=-3.5, to=4.0, step=0.5, hold_s=100, return_=True),
        Sine(offset=2.0, amplitude=1.0, samples_per_period=(600.0, 300.0, 200.0), periods=5),
    ),
    "sines first, real periods": (
        Sine(offset=0.0, amplitude=1.0, samples_per_period=(200.25, 77.7, 12.0), periods=12, lead_periods=2),
        Staircase(from_=0.0, to=1.0, step=0.25, hold_s=30),
    ),
    "sine from the level before it": (
        Staircase(from_=0.0, to=2.0, step=1.0, hold_s=60),
        Sine(offset=1.5, amplitude=0.5, samples_per_period=120.0, periods=6),
        Staircase(from_=2.0, to=0.0, step=1.0, hold_s=60),
    ),
}
RNG = np.random.default_rng


def planned(name):
    experiment = Experiment(dt=DT, parts=PLANS[name])
    plan = experiment.plan()
    return plan, experiment.input(plan, RNG(0))


def check(plan, found, level, period, borders=0):
    assert [part.kind for part in found] == [part.kind for part in plan]
    for a, b in zip(plan, found, strict=True):
        assert abs(a.start - b.start) <= borders
        assert abs(a.stop - b.stop) <= borders
        if a.kind == "hold":
            assert b.level == pytest.approx(a.level, abs=level)
            assert a.direction == b.direction or plan.index(a) == 0 or plan[plan.index(a) - 1].kind != "hold"
        else:
            assert b.period == pytest.approx(a.period, rel=period)
            assert (b.offset, b.amplitude) == pytest.approx((a.offset, a.amplitude), abs=max(level, 1e-9))
            if borders == 0:
                assert b.periods + b.lead_periods == a.periods + a.lead_periods


@pytest.mark.parametrize("name", PLANS)
def test_exact_input(name):
    plan, u = planned(name)
    check(plan, find_parts(u, DT), level=1e-12, period=1e-9)


@pytest.mark.parametrize("name", PLANS)
def test_six_digits(name):
    plan, u = planned(name)
    check(plan, find_parts(np.array([float(f"{x:.6g}") for x in u]), DT), level=1e-5, period=1e-6)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_periods_of_whole_samples_are_found_whole_and_others_are_not(noise):
    n = np.arange(1200.0)
    for seed in range(20):
        for period in (240, 240.25, 57, 57.1):
            u = np.round(0.3 + np.cos(2 * np.pi * n / period) + noise * RNG(seed).standard_normal(1200), 3)
            (sine,) = find_parts(u, DT)
            if period == int(period):
                assert sine.period == period
            else:
                assert sine.period == pytest.approx(period, abs=0.02)
                assert sine.period != round(period)
            assert sine.phase == pytest.approx(0, abs=3e-3)


@pytest.mark.parametrize("bit", [0.002, 0.01])
@pytest.mark.parametrize("name", PLANS)
def test_one_bit_of_converter_noise(name, bit):
    plan, u = planned(name)
    for seed in range(3):
        noise = RNG(seed).standard_normal(len(u))
        dithered = np.round(u / bit + 0.5 * noise) * bit
        flickering = np.round(u / bit) * bit + bit * RNG(seed).integers(-1, 2, len(u))
        for noisy in (dithered, flickering):
            check(plan, find_parts(noisy, DT), level=0.7 * bit, period=1e-3 if "real" not in name else 3e-3, borders=1)


def test_quantised_without_noise_flat_tops_are_no_levels():
    plan, u = planned("design P, up and down")
    check(plan, find_parts(np.round(u / 0.02) * 0.02, DT), level=0.011, period=1e-4)


def test_equal_levels_up_and_down_get_one_value_under_noise():
    _, u = planned("design P, up and down")
    found = find_parts(u + 0.004 * RNG(1).standard_normal(len(u)), DT)
    levels = [part.level for part in found if part.kind == "hold"]
    assert len(levels) == 31
    assert len(set(levels)) == 16


def test_random_steps_are_holds():
    rng = RNG(2)
    lengths = rng.integers(8, 60, 120)
    u = np.repeat(rng.uniform(-1, 1, 120), lengths)
    found = find_parts(u, DT)
    assert [part.length for part in found] == lengths.tolist()
    levels = [part.level for part in found]
    assert [part.direction for part in found[1:]] == ["up" if b > a else "down" for a, b in pairwise(levels)]


@pytest.mark.parametrize("shape", ["white", "ramp", "triangle", "chirp", "multisine", "coloured"])
def test_what_is_neither_stays_out(shape):
    n, rng = np.arange(4000.0), RNG(3)
    u = {
        "white": rng.standard_normal(4000),
        "ramp": n,
        "triangle": np.abs(n % 100 - 50),
        "chirp": np.sin(n**2 * 3e-6),
        "multisine": sum(np.cos(2 * np.pi * k * n / 500 + k**2) for k in range(1, 20)),
        "coloured": np.convolve(rng.standard_normal(4200), 0.95 ** np.arange(200), "valid")[:4000],
    }[shape]
    assert find_parts(np.asarray(u), DT) == ()


def test_a_stretch_of_noise_between_levels_is_left_out():
    u = np.concatenate([np.full(300, -1.0), RNG(4).standard_normal(1000), np.full(300, 2.0)])
    assert [(p.kind, p.start, p.stop) for p in find_parts(u, DT)] == [("hold", 0, 300), ("hold", 1300, 1600)]


def test_use_is_passed_on_and_degenerate_inputs_give_nothing():
    assert {part.use for part in find_parts(planned("design P, up and down")[1], DT, "report")} == {"report"}
    for u in (np.zeros(100), np.array([1.0]), np.full(50, np.nan), np.empty(0)):
        assert find_parts(u, DT) == ()


def test_least_bit():
    assert least_bit(np.round(RNG(0).standard_normal(5000) / 0.005) * 0.005) == pytest.approx(0.005)
    assert least_bit(RNG(0).standard_normal(5000)) == 0.0


@pytest.mark.slow
def test_every_border_in_a_hundred_noisy_records():
    plan, u = planned("design P, up and down")
    right = 0
    for seed in range(100):
        found = find_parts(np.round(u / 0.005 + 0.5 * RNG(seed).standard_normal(len(u))) * 0.005, DT)
        right += [(p.kind, p.start, p.stop) for p in found] == [(p.kind, p.start, p.stop) for p in plan]
    print(f"all borders right: {right}/100")
    assert right >= 98
