"""What cannot be identified is named, with what to try, and no number stands in its place: `whid run` on each case."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from whid.errors import CATALOGUE

LAG = {"kind": "linear", "num": [1], "den": [0.55, 1.3, 1]}
FIFTH = {"kind": "polynomial", "coefficients": [0, 0.5733, 0, 0, 0, 0.4267]}
STICKS = {"kind": "backlash", "rising": [0.15, 1], "falling": [-0.15, 1]}
# from −1 up the rising border stays above what is held there; from 1 down the falling one is met again and again
ONE_SIDED = {"kind": "backlash", "rising": [1, 0, 0.5], "falling": [0.8, 0.6, 0.6]}
EVEN = {"kind": "polynomial", "coefficients": [0.1, 0, 1]}
CLIPPED = {"kind": "saturation", "low": -2, "high": 2}
BAND = {"kind": "noise_band", "band": [0.39, 0.59], "std": 0.2, "duration_s": 4000}
POSITIVE = {"kind": "sine", "offset": 0.3, "amplitude": 0.5, "period": 1000, "periods": 5, "lead_periods": 0}
STEPS = {"kind": "staircase", "from": -1, "to": 1, "step": 0.25, "hold_s": 60}
SQUARED = {"kind": "polynomial", "coefficients": [0, 0, 1]}


def sines(omegas=(0.5, 1.0, 2.0)):
    part = {"kind": "sine", "offset": 0, "amplitude": 1.2, "samples_per_period": 64, "periods": 10, "lead_periods": 3}
    return [{"name": f"w{w}", "dt": float(2 * np.pi / 64 / w), "parts": [part]} for w in omegas]


def discrete(part):
    return {"dt": 1.0, "intersample": "discrete", "path": "sampled", "parts": [part]}


HELD = {
    "dt": 0.1,
    "parts": [
        {"kind": "staircase", "from": -3, "to": 3, "step": 0.25, "hold_s": 20, "return": True},
        {"kind": "sine", "offset": 0, "amplitude": 1.5, "period": 126, "periods": 12, "lead_periods": 2},
    ],
}

CASES = {
    "backlash that never moves": (
        [LAG, STICKS], sines(), {"kind": "wiener_backlash"}, "method-constant-output", "static_or_backlash"
    ),
    "one-sided loops": (
        [LAG, ONE_SIDED], sines((0.3, 0.5, 0.8, 1.0)), {"kind": "wiener_backlash"}, "method-one-sided", "constant_stages"
    ),
    "even curve behind a linear block": (
        [LAG, EVEN], sines(), {"kind": "wiener"}, "method-even-curve", "static_or_backlash"
    ),
    "even curve behind pieces": (
        [CLIPPED, LAG, SQUARED], HELD, {"kind": "hammerstein_wiener"}, "method-even-curve", "segmentation"
    ),
    "one-sided window": (
        [FIFTH], discrete(POSITIVE), {"kind": "memoryless", "domain": [-1, 1]}, "stage-one-sided", None
    ),
    "rank-one window": (
        [FIFTH], discrete(STEPS), {"kind": "memoryless", "domain": [-1, 1]}, "stage-rank-one", None
    ),
    "equaliser beyond the data": (
        [FIFTH], discrete(BAND), {"kind": "memoryless", "domain": [-0.66, 0.64], "inverse": True, "report": "least_squares"},
        "stage-extrapolates", "noise_colour",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_refused_by_name(name, whid, tmp_path, monkeypatch):
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    chain, experiment, identify, code, kept = CASES[name]
    study = {"name": "refused", "seed": 1, "plant": {"chain": chain, "noise": {"kind": "white", "std": 0.005}},
             "experiment": experiment, "identify": identify}  # fmt: skip
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
    done = whid("run", "study.yaml")
    assert done.exit_code == 3, done.output
    assert f"error[{code}]" in done.stderr
    assert f"try: {CATALOGUE[code].remedy}" in done.stderr
    assert "Traceback" not in done.output
    assert "\nModel" not in done.stdout
    if kept:
        assert f"after {kept}" in done.stderr
    (summary,) = (tmp_path / "runs").glob("*/summary.md")
    assert f"**incomplete** ({code})" in summary.read_text()
    assert CATALOGUE[code].remedy in summary.read_text()


def test_a_piece_below_the_noise_is_not_resolved(whid, tmp_path, monkeypatch):
    """A2 at σ = .2: f turns by .05 where the left pieces run. The summary says what is not known."""
    monkeypatch.setattr("whid.plots.draw", lambda run, folder: ((), ()))
    config = Path(__file__).parents[2] / "configs" / "brouri2014" / "a2.yaml"
    done = whid("run", config, "--set", "plant.noise.std=0.2")
    assert done.exit_code in (0, 4), done.output  # its bounds are those of a noise of .05
    (summary,) = (tmp_path / "runs").glob("*/summary.md")
    for text in (done.stdout, summary.read_text()):
        assert "piece not resolved" in text
        assert "average more periods" in text
