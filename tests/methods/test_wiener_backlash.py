"""The whole method on simulated records: B2, a static curve, a backlash that never moves, an even curve, transients."""

from dataclasses import replace

import numpy as np
import pytest

from tests.giri import B2, B3, B4
from whid.blocks.backlash import Backlash
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.disturbances.ar import Ar
from whid.disturbances.white import White
from whid.errors import WhidError
from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.methods._method import Model
from whid.methods.wiener import Wiener
from whid.methods.wiener_backlash import WienerBacklash
from whid.score import linear_gain
from whid.simulate import simulate
from whid.system import System

G = Linear(num=(1.0,), den=(0.55, 1.3, 1.0))
OMEGA = (0.5, 1.0, 2.0)


def records(block, seed, snr=40.0, amplitude=1.2, omegas=OMEGA, offset=0.0, samples=128, periods=12, noise=None):
    plant = System(chain=(G, block), noise=(noise or White(snr_db=snr),))
    rng, found = np.random.default_rng(seed), []
    for w in omegas:
        sine = Sine(offset=offset, amplitude=amplitude, samples_per_period=samples, periods=periods, lead_periods=3)
        found.append(simulate(plant, Experiment(dt=2 * np.pi / samples / w, parts=(sine,), name=f"w{w}"), rng))
    return found


def run(method, data):
    stages = list(method(data))
    assert isinstance(stages[-1], Model)
    return stages


def the(stages, name):
    return next(stage for stage in stages if type(stage).__name__ == name)


def scores(model, system):
    """(estimate − truth)/standard error of every number."""
    true = {p.name: p.value for p in system.tree.parameters(held=True)}
    e = model.estimate
    return np.array([(v - true[n]) / s for n, v, s in zip(e.names, e.values, e.std, strict=True)])


def test_b2_end_to_end_and_all_numbers_on_all_samples():
    block = Backlash(rising=B2[0], falling=B2[1])
    stages = run(WienerBacklash(whole_record=True), records(block, 11))
    assert [type(stage).__name__ for stage in stages] == [
        "SettledPeriods", "NoiseColour", "StaticOrBacklash", "ConstantStages", "SeparableBorders", "PaperBorders",
        *["LinkedLoop"] * 3,
        "JointLoops", "Admissible", "TransferFunction", "ParametricLoops", "Refined", "Model",
    ]  # fmt: skip
    assert the(stages, "StaticOrBacklash").backlash
    found = the(stages, "ParametricLoops").estimate
    assert abs(found.reduced_chi2 - 1) < 5 * np.sqrt(2 / found.dof)
    assert len(the(stages, "TransferFunction").den) == 3
    model = stages[-1]
    assert np.abs(scores(model, System(chain=(G, block)))).max() < 4.5
    assert any("(−G, F[−x])" in said for said in model.missing)
    paper, ours = the(stages, "PaperBorders").metrics(), the(stages, "JointLoops").metrics()
    assert {name.removeprefix("paper.") for name in paper} == set(ours)
    for name, value in ours.items():
        other = paper[f"paper.{name}"]
        assert abs(other.value - value.value) < 5 * np.hypot(other.std, value.std), name
        assert other.std > value.std or name.startswith("rising"), name


def test_a_static_curve_is_told_and_plain_wiener_is_the_same():
    curve = Polynomial(coefficients=B3[0])
    data = records(curve, 12)
    stages = run(WienerBacklash(), data)
    assert not the(stages, "StaticOrBacklash").backlash
    assert the(stages, "JointLoops").static
    assert np.abs(scores(stages[-1], System(chain=(G, curve)))).max() < 4.5
    plain = run(Wiener(), data)[-1]
    assert plain.system == stages[-1].system
    assert isinstance(plain.system.chain[-1], Polynomial)


def test_noise_free_it_is_exact():
    block = Backlash(rising=B2[0], falling=B2[1])
    data = records(block, 13, snr=200.0, periods=12)
    model = run(WienerBacklash(), [replace(r, parts=tuple(replace(p, lead_periods=9) for p in r.parts)) for r in data])[-1]
    true = {p.name: p.value for p in System(chain=(G, block)).tree.parameters(held=True)}
    assert max(abs(v - true[n]) for n, v in zip(model.estimate.names, model.estimate.values, strict=True)) < 2e-5


def test_one_frequency_keeps_what_was_found():
    block, stages = Backlash(gap=0.3), []
    with pytest.raises(WhidError) as fault:
        stages.extend(WienerBacklash(degree=1)(records(block, 14, omegas=(1.0,))))
    assert fault.value.code == "method-few-frequencies"
    found = []
    for stage in WienerBacklash(degree=1)(records(block, 14, omegas=(1.0,))):
        found.append(stage)
        if type(stage).__name__ == "Admissible":
            break
    joint = the(found, "JointLoops")
    assert abs(joint.falling[0] - joint.rising[0] - 0.3) < 5 * np.hypot(joint.falling_std[0], joint.rising_std[0])


@pytest.mark.parametrize(
    ("block", "code", "options"),
    [
        (Backlash(rising=B4[0], falling=B4[1]), "method-constant-output", {}),
        (Polynomial(coefficients=(0.1, 0.0, 1.0)), "method-even-curve", {}),
        (Backlash(gap=0.3), "method-no-sines", {"offset": 0.5}),
    ],
)
def test_refusals_have_a_name(block, code, options):
    data = records(block, 15, snr=40.0, omegas=(0.5, 1.0), **options)
    if code == "method-constant-output":
        settled = System(chain=(G, block)).tree(data[0].u, data[0].dt)[-512:]
        assert np.ptp(settled) < 1e-9
    with pytest.raises(WhidError) as fault:
        list(WienerBacklash()(data))
    assert fault.value.code == code
    assert fault.value.remedy


def test_coloured_noise_is_warned_of_and_white_noise_is_not():
    block = Backlash(rising=B2[0], falling=B2[1])
    white, coloured = (
        next(found for found in WienerBacklash()(records(block, 18, noise=noise)) if type(found).__name__ == "NoiseColour")
        for noise in (White(std=0.01), Ar(std=0.01, coefficients=(0.9,)))
    )
    assert white.doubts() == ()
    (said,) = coloured.doubts()
    assert said.startswith("coloured noise")
    assert "too small" in said
    assert coloured.factor == pytest.approx(np.sqrt(19), rel=0.25)


def test_what_is_left_out_is_said_and_why():
    """A sine about an offset, and one too short, beside three that will do."""
    block = Backlash(rising=B2[0], falling=B2[1])
    data = [
        *records(block, 20), *records(block, 21, offset=0.4, omegas=(1.5,)), *records(block, 22, periods=1, omegas=(3.0,)),
    ]  # fmt: skip
    model = run(WienerBacklash(), data)[-1]
    aside, short = (next(said for said in model.missing if key in said) for key in ("offset", "two periods"))
    assert "1.5 rad/s about 0.4" in aside
    assert "3 rad/s" in short
    with pytest.raises(WhidError, match=r"1\.5 rad/s about 0\.4") as fault:
        list(WienerBacklash()(data[3:4]))
    assert fault.value.code == "method-no-sines"


def test_the_gain_is_that_of_the_plant():
    stages = run(WienerBacklash(), records(Backlash(rising=B2[0], falling=B2[1]), 17))
    ratio = linear_gain(stages[-1].system, "front", np.array(OMEGA)) / G.gain_at(np.array(OMEGA))
    assert np.abs(ratio - 1).max() < 0.003
