"""Signals: the rule, and what each declared course between samples is."""

import numpy as np
import pytest

from whid.signal import Signal, at, cut, held, joined, rule


@pytest.mark.parametrize("q", [2, 4, 8, 24, 40])
def test_the_rule_is_exact_and_interpolates(q):
    r = rule(q)
    for power in range(0, 2 * q, 3):
        assert r.weights @ r.nodes**power == pytest.approx(1 / (power + 1), rel=1e-13)
    values = np.cos(2 * r.nodes)
    np.testing.assert_allclose(r.ends @ values, [1.0, np.cos(2.0)], atol=0.2 * 2.0**-q + 1e-13 + (0.4 if q == 2 else 0))
    np.testing.assert_allclose(at(values[:, None], r.nodes[:, None])[:, 0], values, atol=1e-13)


@pytest.mark.parametrize("intersample", ["discrete", "zoh"])
def test_a_held_signal_is_constant(intersample):
    signal = held(np.array([1.0, -2.0]), 0.1, intersample)
    np.testing.assert_array_equal(signal.panels.values, np.tile([1.0, -2.0], (4, 1)))
    assert signal.sampled == (intersample == "discrete")


def test_a_first_order_hold_joins_the_samples():
    u = np.array([0.0, 2.0, -1.0])
    panels = held(u, 0.1, "foh", order=6).panels
    t = np.arange(3) + rule(6).nodes[:, None]
    np.testing.assert_allclose(panels.values, np.interp(t, np.arange(3), u), atol=1e-15)


def test_a_band_limited_signal_is_its_cosines():
    """Cosines that end at a peak are their own mirror image: interpolated without error."""
    n = np.arange(61)
    u = 0.3 + np.cos(2 * np.pi * n / 20) + 0.5 * np.cos(2 * np.pi * n * 7 / 60)
    t = n[:-1] + rule(8).nodes[:, None]
    exact = 0.3 + np.cos(2 * np.pi * t / 20) + 0.5 * np.cos(2 * np.pi * t * 7 / 60)
    np.testing.assert_allclose(held(u, 0.1, "bandlimited", order=8).panels.values[:, :-1], exact, atol=1e-12)


@pytest.mark.parametrize("intersample", ["discrete", "zoh", "foh", "bandlimited"])
@pytest.mark.parametrize("samples", [0, 1, 2])
def test_short_signals(intersample, samples):
    assert held(np.ones(samples), 0.1, intersample).panels.values.shape == (4, samples)


@pytest.mark.parametrize("intersample", ["discrete", "zoh", "foh", "bandlimited"])
def test_a_stretch_of_a_signal_is_the_signal_there(intersample):
    whole = held(np.random.default_rng(0).standard_normal(20), 0.5, intersample, t0=3.0)
    part = whole[4:9]
    assert part.t0 == 5.0
    np.testing.assert_array_equal(part.values, whole.values[4:9])
    np.testing.assert_array_equal(part.panels.values, whole.panels.values[:, 4:9])
    np.testing.assert_array_equal(joined(whole[:4], part, whole[9:]).panels.values, whole.panels.values)
    assert cut(whole.panels, 2, 2).values.shape == (4, 0)


def test_a_lazy_course_is_made_once():
    made = []

    def between():
        made.append(1)
        return held(np.zeros(3), 0.1, "foh").panels

    signal = Signal(np.zeros(3), 0.1, between=between)
    assert not made
    assert signal.panels is signal.panels
    assert made == [1]
