"""One hidden mechanism for every effect at every place, on a small plant: the contract tests run over them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tests.trace_plants import DT, PLANT, STD, lacking
from whid.blocks.backlash import Backlash
from whid.blocks.bend import Bend
from whid.blocks.clock_skew import ClockSkew
from whid.blocks.coulomb import Coulomb
from whid.blocks.dead_zone import DeadZone
from whid.blocks.delay import Delay
from whid.blocks.drift import Drift
from whid.blocks.feedback import Feedback
from whid.blocks.gain_drift import GainDrift
from whid.blocks.gain_step import GainStep
from whid.blocks.hinge import Hinge
from whid.blocks.intersample import Intersample
from whid.blocks.jump import Jump
from whid.blocks.linear import Linear
from whid.blocks.offset_step import OffsetStep
from whid.blocks.parallel import Parallel
from whid.blocks.polynomial import Polynomial
from whid.blocks.quantizer import Quantizer
from whid.blocks.saturation import Saturation
from whid.blocks.slew_limit import SlewLimit
from whid.blocks.tone import Tone
from whid.effects._effect import Effect
from whid.signal import Floats
from whid.system import System

Spoil = Callable[[Floats, np.random.Generator], Floats]
CLIP = System(
    chain=(PLANT.chain[0], Saturation(low=-0.8, high=0.7), PLANT.chain[2]),
    noise=PLANT.noise,
)


@dataclass(frozen=True)
class Example:
    """A truth, what is declared instead, what happens to the samples, and what must be found.

    numbers  of the effect, by the end of their names
    bias     relative: what a truth of another form is allowed
    """

    name: str
    truth: System = PLANT
    declared: System = PLANT
    spoil: Spoil = lambda y, rng: y
    numbers: dict[str, float] = field(default_factory=dict)
    bias: float = 0.0

    @property
    def effect(self) -> Effect:
        """Return the effect."""
        kind, _, place = self.name.partition("/")[0].partition("@")
        return Effect.named(kind)(place=place)


def _beside(branch: object) -> System:
    return replace(PLANT, chain=(PLANT.chain[0], Parallel(parallel=(PLANT.chain[1], branch)), PLANT.chain[2]))


def _around(back: object) -> System:
    return replace(PLANT, chain=(Feedback(forward=PLANT.tree, back=back, solve="continuous"),))


def _coloured(y: Floats, rng: np.random.Generator) -> Floats:
    from scipy.signal import lfilter

    return y + STD * lfilter([1.0], [1.0, -0.9], rng.standard_normal(len(y)))


def _wild(y: Floats, rng: np.random.Generator) -> Floats:
    out = y.copy()
    out[rng.choice(len(y), 8, replace=False)] += 15 * STD
    return out


def _hanging(y: Floats, rng: np.random.Generator) -> Floats:
    out = y.copy()
    for start in rng.integers(50, len(y) - 50, 4):
        out[start : start + 6] = out[start]
    return out


GAUGE = 0.12  # what comes out of a curve scales with gains around it that were declared up to 5 % wrong each and are held
LAG = Linear(num=(1.0,), den=(0.12, 1.0))
PAIR = Linear(num=(1.0,), den=(0.04, 0.04, 1.0))
MOVING = {"front": 1, "back": 3}
# beside a front of second order a pair cannot be told from the front itself: which of the two is which is a matter of words
LAGGED = PLANT.replaced(0, Linear(num=(1.0,), den=(0.4, 1.0)))

EVERY = (
    Example("saturation@input", lacking(0, Saturation(low=-1.9, high=1.8)), numbers={"low": -1.9, "high": 1.8}),
    Example("saturation@output", lacking(3, Saturation(low=-9.0, high=1.1)), numbers={"high": 1.1}),
    Example("dead_zone@input", lacking(0, DeadZone(low=-0.15, high=0.15)), numbers={"low": -0.15, "high": 0.15}),
    Example("curve@input", lacking(0, Bend(coefficients=(0.0, -0.2), scale=2.5)), numbers={}),
    Example("curve@output", lacking(3, Bend(coefficients=(0.0, -0.2), scale=2.0)), numbers={}),
    Example("slew_limit@input", lacking(0, SlewLimit(rate=6.0)), numbers={"rate": 6.0}),
    Example("backlash@input", lacking(0, Backlash(gap=0.2)), numbers={"gap": 0.2}),
    Example("backlash@output", lacking(3, Backlash(gap=0.1)), numbers={"gap": 0.1}),
    *(Example(f"lag@{side}", lacking(k, LAG), numbers={"den.0": 0.12}) for side, k in MOVING.items()),
    Example("resonance@front", LAGGED.inserted(1, PAIR), LAGGED, numbers={"den.0": 0.04, "den.1": 0.04}),
    Example("resonance@back", lacking(3, PAIR), numbers={"den.0": 0.04, "den.1": 0.04}),
    Example("jump@nonlinearity", _beside(Jump(at=0.4, height=0.2)), numbers={"height": 0.2}, bias=GAUGE),
    Example("kink@nonlinearity", _beside(Hinge(at=0.3, slope=-0.4)), numbers={"at": 0.3, "slope": -0.4}, bias=GAUGE),
    Example(
        "soft_knee@nonlinearity", CLIP.replaced(1, Saturation(low=-0.8, high=0.7, knee=0.5)), CLIP, numbers={"knee": 0.5}
    ),
    Example("drift@output/ramp", lacking(3, Drift(times=(0.0, 100.0), levels=(0.0, 0.2)))),
    Example("drift@output/sine", PLANT.inserted(3, Tone(omega=0.12, cos=(0.06,), sin=(0.0,)))),
    Example("gain_drift@output", lacking(3, GainDrift(times=(0.0, 200.0), levels=(0.0, 0.4)))),
    Example("offset_step@output", lacking(3, OffsetStep(at_s=60.0, height=0.05)), numbers={"height": 0.05}),
    Example("gain_step@output", lacking(3, GainStep(at_s=60.0, height=-0.1)), numbers={"height": -0.1}),
    Example("hum@output", PLANT.inserted(3, Tone(omega=11.3, cos=(0.03,), sin=(0.02,))), numbers={"omega": 11.3}),
    Example("outliers@output", spoil=_wild),
    Example("dropouts@output", spoil=_hanging),
    Example("quantizer@output", spoil=lambda y, rng: 0.05 * np.round(y / 0.05), numbers={"step": 0.05}, bias=1e-9),
    Example("quantizer@input", lacking(0, Quantizer(step_=0.35)), numbers={"step_": 0.35}, bias=0.005),
    Example("feedback_static@loop", _around(Polynomial(coefficients=(0.0, 0.2))), numbers={"coefficients.1": 0.2}),
    Example(
        "feedback_dynamic@loop", _around(Linear(num=(0.2,), den=(3.0, 1.0))), numbers={"back.num.0": 0.2, "back.den.0": 3.0}
    ),
    Example("parallel_linear@parallel", PLANT.beside(Linear(num=(0.1,), den=(2.0, 1.0))), numbers={"num.0": 0.1}),
    Example("friction@parallel", PLANT.beside(Coulomb(force=0.05)), numbers={"force": 0.05}),
    Example("delay@time", lacking(3, Delay(seconds=0.07)), numbers={"seconds": 0.07}),
    Example("clock_skew@time", lacking(3, ClockSkew(skew=1e-3)), numbers={"skew": 1e-3}),
    Example("intersample@time", lacking(0, Intersample(between="foh"))),
    Example(
        "jitter@time",
        spoil=lambda y, rng: y + 0.02 * np.gradient(y, DT) * rng.standard_normal(len(y)),
        numbers={"std": 0.02},
    ),
    Example("coloured_noise@noise", spoil=_coloured),
    Example(
        "level_noise@noise",
        spoil=lambda y, rng: y + 0.04 * y * rng.standard_normal(len(y)),
        numbers={"std": 0.04},
        bias=0.02,
    ),
    Example(
        "process_noise@noise",
        System(chain=PLANT.chain[:2], noise=PLANT.noise),
        System(chain=PLANT.chain[:2], noise=PLANT.noise),
        lambda y, rng: y + 0.05 * (1 + 0.4 * y) * rng.standard_normal(len(y)),
    ),
)
EXAMPLES = {example.name: example for example in EVERY}
