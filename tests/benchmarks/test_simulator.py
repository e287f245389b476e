"""Simulation per sample, as ratios measured in one process: medians of five."""

import time

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from tests.test_simulator_bar import BACK, CURVE, DT, FRONT, PLANT

SAMPLES = 1_000_000


def seconds(run, repeats=5):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def with_noise(y, rng):
    return y + 0.5 * rng.standard_normal(len(y))


@pytest.mark.slow
def test_simulation_against_control_and_against_bare_filters():
    rng = np.random.default_rng(1)
    u = 2 + np.cos(0.02 * DT * np.arange(SAMPLES))
    t, few = DT * np.arange(20_000), u[:20_000]
    front, back = FRONT.control(), BACK.control()

    def by_control():
        v = control.forced_response(front, t, few).outputs
        with_noise(control.forced_response(back, t, CURVE.value(v)).outputs, rng)

    filters = [cont2discrete((b.num, b.den), DT, "zoh")[:2] for b in (FRONT, BACK)]

    def bare():
        (b1, a1), (b2, a2) = filters
        with_noise(lfilter(b2[0], a2, CURVE.value(lfilter(b1[0], a1, u))), rng)

    reference = seconds(by_control) / len(few)
    plain = seconds(bare) / SAMPLES
    sampled = seconds(lambda: with_noise(PLANT(u, DT, "discrete"), rng)) / SAMPLES
    exact = seconds(lambda: with_noise(PLANT(u, DT, "zoh"), rng)) / SAMPLES
    print(
        f"per sample: control {reference * 1e9:.0f} ns, bare {plain * 1e9:.0f} ns, sampled {sampled * 1e9:.0f} ns "
        f"({reference / sampled:.0f} x faster, {sampled / plain:.2f} of bare), exact {exact * 1e9:.0f} ns "
        f"({reference / exact:.0f} x faster, {exact * 1e6:.2f} s per 1e6)"
    )
    assert reference / sampled >= 60
    assert sampled / plain <= 1.5
    assert reference / exact >= 20
    assert exact * 1e6 <= 1.0
