"""The declared intersample assumption against what was simulated: the confusion table, printed."""

import numpy as np
import pytest
from scipy.signal import lfilter

from whid.blocks.chain import Chain
from whid.blocks.dead_zone import DeadZone
from whid.blocks.linear import Linear
from whid.signal import held
from whid.stages.intersample import intersample

N, DT = 6000, 0.4
PLANTS = {
    "first order": Linear(num=(1.0,), den=(1.0, 1.0)),
    "second order": Linear(num=(1.0,), den=(1.0, 1.2, 1.0)),
    "wiener-hammerstein": Chain(
        chain=(Linear(num=(2.0,), den=(1.0, 2.0)), DeadZone(low=-0.3, high=0.3), Linear(num=(1.5,), den=(1.0, 1.5)))
    ),
}
TRUTHS = ("zoh", "foh", "bandlimited", "discrete")


def simulated(plant, truth, seed, hold=1):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.standard_normal(N // hold), hold)
    y = PLANTS[plant].step(held(u, DT, truth))[0].values
    return u, y + 0.02 * y.std() * rng.standard_normal(len(y))


@pytest.mark.parametrize("plant", PLANTS)
def test_confusion(plant):
    for truth in TRUTHS:
        found = {d: [intersample(*simulated(plant, truth, seed), d) for seed in range(5)] for d in TRUTHS}
        print(plant, truth, {d: results[0].alternative or results[0].verdict for d, results in found.items()})
        assert all(r.verdict != "does not fit" for r in found[truth])  # the truth is never refused
        held_truth = truth in ("zoh", "discrete")
        for declared in TRUTHS:
            if (declared in ("zoh", "discrete")) == held_truth:
                continue
            if truth == "discrete" and plant == "wiener-hammerstein":  # two samples of delay: nothing at lag 1 to judge by
                continue
            assert all(r.verdict == "does not fit" for r in found[declared]), (truth, declared)
            assert all((r.alternative in ("zoh", "discrete")) == held_truth for r in found[declared])


def test_straight_lines_and_band_limited_input_are_told_apart_on_a_quick_plant():
    assert intersample(*simulated("first order", "bandlimited", 1), "foh").alternative == "bandlimited"
    assert intersample(*simulated("first order", "foh", 1), "bandlimited").verdict == "fits"


def test_held_steps_are_never_called_band_limited():
    for plant in PLANTS:
        result = intersample(*simulated(plant, "zoh", 2, hold=5), "bandlimited")
        assert (result.verdict, result.alternative) == ("does not fit", "zoh")
        assert intersample(*simulated(plant, "zoh", 2, hold=5), "zoh").verdict != "does not fit"


def test_says_so_when_it_cannot_tell():
    n = np.arange(N)
    u = np.cos(2 * np.pi * n / 50)
    y = PLANTS["first order"].step(held(u, DT, "foh"))[0].values
    assert intersample(u, y, "zoh").verdict == "cannot tell"  # a sine: half a sample of delay could be the plant's
    rng = np.random.default_rng(1)
    assert intersample(rng.standard_normal(3000), rng.standard_normal(3000), "zoh").verdict == "cannot tell"
    assert intersample(rng.standard_normal(50), rng.standard_normal(50), "zoh").verdict == "cannot tell"


def test_size_under_the_truth():
    wrong = 0
    for seed in range(100):
        wrong += intersample(*simulated("first order", "zoh", seed), "zoh").verdict == "does not fit"
    print(f"false alarms: {wrong}/100")
    assert wrong == 0


@pytest.mark.parametrize("seed", range(5))
def test_a_few_rounded_sines_cannot_tell(seed):
    """Nine lines through a lag and a play, the input held: nothing answers before u moves, though u looks as if it did."""
    rng = np.random.default_rng(71_000 + seed)
    n = np.arange(4000)
    lines = np.array([1, 3, 5, 9, 13, 21, 31, 45, 61])
    u = np.round(np.cos(2 * np.pi * np.outer(n, lines) / 500 + rng.uniform(0, 2 * np.pi, 9)).sum(axis=1) / 2, 3)
    lagged = lfilter([0.0, 0.25], [1.0, -0.875], u)
    held, w = np.empty(4000), 0.0
    for k, v in enumerate(lagged):
        w = held[k] = min(max(w, v - 0.4), v + 0.4)
    found = intersample(u, held + 0.05 * rng.standard_normal(4000), "zoh")
    assert found.verdict == "cannot tell"
