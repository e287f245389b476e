"""The first-contact rule: bar D1, what happens between samples, and a gap found beside a linear block."""

import numpy as np
import pytest

from tests.blocks.backlash_reference import first_contact
from whid.blocks._split import value_at
from whid.blocks.backlash import Backlash
from whid.blocks.chain import Chain
from whid.blocks.feedback import Feedback
from whid.blocks.linear import Linear
from whid.blocks.parallel import Parallel
from whid.blocks.polynomial import Polynomial
from whid.blocks.viscous import Viscous
from whid.errors import WhidError
from whid.record import Record
from whid.refine import bound, refine
from whid.signal import held
from whid.system import System

BORDERS = {
    "gear": ((-0.15, 1.0, 0.0, 0.05), (0.15, 1.0, 0.0, 0.05)),
    "crossing": ((-0.3, 0.7, 0.8, -0.8), (-0.2, 0.7, 0.7, -0.1)),
    "static": ((0.2, 1.0, 0.5, -0.6), (0.2, 1.0, 0.5, -0.6)),
    "rising above falling": ((0.15, 1.0), (-0.15, 1.0)),
    "loop closed at its ends": ((0.12, 1.0, -0.2), (-0.12, 1.0, 0.2)),
}
LAG = Linear(num=(1.0,), den=(0.3, 1.0))


def inputs(samples):
    rng, n = np.random.default_rng(41), np.arange(samples)
    return {
        "sine": 1.3 * np.sin(0.06 * n),
        "noise": rng.normal(size=samples),
        "walk": np.cumsum(0.02 * rng.normal(size=samples)),
        "sine and noise": np.sin(0.01 * n) + 0.05 * rng.normal(size=samples),
        "steps": np.repeat(rng.normal(size=samples // 10), 10),
    }


@pytest.mark.parametrize("name", BORDERS)
def test_bar_d1_no_sample_differs_from_the_rule(name):
    rising, falling = BORDERS[name]
    block = Backlash(rising=rising, falling=falling)
    for wave, x in inputs(20_000).items():
        differing = np.flatnonzero(block(x, 1.0, "discrete") != first_contact(x, rising, falling))
        assert len(differing) == 0, (wave, differing[:5])


@pytest.mark.parametrize("course", ["discrete", "zoh", "foh", "bandlimited"])
def test_bar_d1_equal_borders_are_a_static_curve(course):
    curve = BORDERS["static"][0]
    static, block = Polynomial(coefficients=curve), Backlash(rising=curve, falling=curve)
    trees = [lambda b: b] + ([lambda b: Chain(chain=(LAG, b, LAG))] if course != "discrete" else [])
    for x in inputs(3000).values():
        u = held(x, 0.2, course, order=24)  # white noise through a cubic: fewer nodes leave a quadrature error of their own
        for tree in trees:
            expected = tree(static).step(u)[0].values
            assert np.abs(tree(block).step(u)[0].values - expected).max() < 1e-12 * max(1.0, np.abs(expected).max())


def test_a_gap_is_the_classical_play():
    x = inputs(2000)["sine and noise"]
    w, expected = 0.0, []
    for v in x:
        w = min(max(w, v - 0.2), v + 0.2)
        expected.append(w)
    np.testing.assert_array_equal(Backlash(gap=0.4)(x, 1.0, "discrete"), expected)
    assert np.array_equal(Backlash(gap=0.0)(x, 1.0, "discrete"), x)


@pytest.mark.parametrize("name", ["gear", "crossing", "loop closed at its ends"])
def test_between_samples_turning_points_and_contacts_are_met(name):
    """Eighteen samples a period, against the per-sample rule on 400 times as many."""
    rising, falling = BORDERS[name]
    n, fine = np.arange(90), 400
    u = held(np.sin(0.35 * n + 0.3), 0.2, "bandlimited", order=12)
    behind_lag = LAG.step(u)[0]
    dense = np.column_stack([value_at(behind_lag.panels, n, np.full(len(n), k / fine)) for k in range(fine)]).ravel()
    expected = first_contact(dense, rising, falling)
    out = Chain(chain=(LAG, Backlash(rising=rising, falling=falling))).step(u)[0]
    np.testing.assert_allclose(out.values, expected[::fine], atol=2e-5)  # the fine rule's own error
    inner = np.column_stack([value_at(out.panels, n, np.full(len(n), (k + 0.5) / fine)) for k in range(fine)]).ravel()
    assert np.abs(inner[:-1] - (expected[:-1] + expected[1:]) / 2).max() < 1e-3


def test_the_same_in_chunks_of_a_long_record():
    block = Chain(chain=(LAG, Backlash(rising=BORDERS["crossing"][0], falling=BORDERS["crossing"][1]), LAG))
    u = held(inputs(6000)["sine and noise"], 0.2, "zoh")
    whole, state, parts = block.step(u)[0].values, None, []
    for start in range(0, 6000, 997):
        out, state = block.step(u[start : start + 997], state)
        parts.append(out.values)
    np.testing.assert_allclose(np.concatenate(parts), whole, rtol=0, atol=1e-12)


def test_inside_a_loop_and_beside_a_branch():
    u = held(np.sin(0.3 * np.arange(60)), 0.1, "zoh")
    for tree in (
        Feedback(forward=Chain(chain=(Backlash(gap=0.2), LAG)), back=Viscous(coefficient=0.5)),
        Parallel(parallel=(Backlash(gap=0.2), LAG)),
    ):
        names = [p.name for p in tree.parameters()]
        gap = next(name for name in names if name.endswith("gap"))
        moved = [tree.with_parameters({gap: 0.2 + h}).step(u)[0].values for h in (-1e-6, 1e-6)]
        out = tree.tangent(u, [], names)
        np.testing.assert_allclose(out.tangents[names.index(gap)].values, (moved[1] - moved[0]) / 2e-6, atol=1e-6)


@pytest.mark.parametrize("wrong", [{}, {"gap": 0.1, "rising": (0.0, 1.0)}, {"rising": (0.0,)}, {"gap": -0.1}])
def test_refused(wrong):
    with pytest.raises(WhidError) as fault:
        Backlash(**wrong)
    assert fault.value.code == "block-parameters"


def plant(gap, time_constant=0.3):
    return System(chain=(Linear(num=(1.2,), den=(time_constant, 1.0), fix=("den.1",)), Backlash(gap=gap)))


def gap_fits(seeds, samples=1500):
    truth, u = plant(0.25), np.repeat(np.random.default_rng(77).normal(size=samples // 15), 15)
    clean = truth.tree(u, 0.1)
    limit = bound(truth, [Record(u=u, y=clean, dt=0.1)], [0.05])
    found = []
    for seed in seeds:
        y = clean + 0.05 * np.random.default_rng(seed).normal(size=samples)
        fit = refine(plant(0.1, 0.5), [Record(u=u, y=y, dt=0.1)])
        found.append(fit.estimate.values)
    return np.array(found), np.array([1.2, 0.3, 0.25]), limit


def test_a_gap_is_found_beside_a_linear_block():
    found, truth, limit = gap_fits([1, 2, 3])
    assert limit.names == ("chain.0.num.0", "chain.0.den.0", "chain.1.gap")
    assert np.abs((found - truth) / limit.std).max() < 4


@pytest.mark.slow
def test_a_gap_is_found_as_well_as_can_be():
    """60 held-out seeds: RMSE/CRB within the χ² interval of that count."""
    found, truth, limit = gap_fits(range(50_000, 50_060))
    ratio = np.sqrt(np.mean((found - truth) ** 2, axis=0)) / limit.std
    print(f"gap beside a lag: RMSE/CRB {ratio.round(3)} of {limit.names}")
    assert np.all(ratio < 1.3)
    assert np.abs((found - truth) / limit.std).max() < 4.5
