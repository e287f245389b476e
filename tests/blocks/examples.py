"""One or more examples of every kind of block: the contract tests run over them.

A new kind fails `test_contract.py` until it has an example here. Examples have a steady state at every level, settle
within a few hundred samples of dt = 0.2 s, and are hit at their breakpoints by an input within ±2.
"""

from whid.blocks._block import Block
from whid.blocks.backlash import Backlash
from whid.blocks.bend import Bend
from whid.blocks.chain import Chain
from whid.blocks.clock_skew import ClockSkew
from whid.blocks.constant import Constant
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
from whid.blocks.kinked import Kinked
from whid.blocks.linear import Linear
from whid.blocks.offset_step import OffsetStep
from whid.blocks.oversampled import Oversampled
from whid.blocks.parallel import Parallel
from whid.blocks.piecewise import Piecewise
from whid.blocks.polynomial import Polynomial
from whid.blocks.preload import Preload
from whid.blocks.quantizer import Quantizer
from whid.blocks.relay import Relay
from whid.blocks.saturation import Saturation
from whid.blocks.slew_limit import SlewLimit
from whid.blocks.spline import Spline
from whid.blocks.table import Table
from whid.blocks.tone import Tone
from whid.blocks.viscous import Viscous

DT = 0.2
CLOCKED = (
    "tone",
    "drift",
    "gain_drift",
    "offset_step",
    "gain_step",
    "clock_skew",
)  # kinds that do something of their own in time: no steady output, and t0 matters
LAG = Linear(num=(1.5,), den=(1.0, 2.0))
RESONANT = Linear(num=(1.0, 3.0), den=(1.0, 0.9, 4.0))

EXAMPLES: dict[str, tuple[Block, ...]] = {
    "backlash": (
        Backlash(gap=0.43),
        Backlash(rising=(-0.3, 0.7, 0.8, -0.8), falling=(-0.2, 0.7, 0.7, -0.1)),  # crossing, not invertible
        Backlash(rising=(0.05, 1.0), falling=(-0.05, 0.4, 0.1)),  # of unlike degree, the rising one above at first
    ),
    "bend": (Bend(coefficients=(0.1, -0.05, 0.02), centre=0.2, scale=1.5), Bend(coefficients=(0.2,))),
    "chain": (
        Chain(chain=(RESONANT, Piecewise(breaks=(-0.3, 0.4), pieces=((0.5,), (0.0, 1.0, 0.3), (-0.4,))), LAG)),
        Chain(chain=(Saturation(low=-0.5, high=0.7), LAG, Preload(offset=0.2), RESONANT)),
        Chain(chain=(LAG, Preload(offset=0.2), Backlash(gap=0.3), RESONANT)),  # jumps go through a backlash
        Chain(chain=(LAG, Preload(offset=0.2), Polynomial(coefficients=(0.0, 1.0, 0.5, 0.2)), LAG)),
        Chain(
            chain=(LAG, Coulomb(force=0.3), Linear(num=(1.0, 1.0), den=(1.0, 2.0)), Polynomial(coefficients=(0.1, 1.0, 0.4)))
        ),
    ),
    "clock_skew": (ClockSkew(skew=-0.021), ClockSkew(skew=0.013)),
    "constant": (Constant(level=-3.2),),
    "coulomb": (Coulomb(force=0.7, offset=-0.1),),
    "dead_zone": (DeadZone(low=-0.3, high=0.55, slope=1.7), DeadZone(low=-0.3, high=0.55, slope=1.7, knee=0.4)),
    "delay": (Delay(seconds=0.47), Delay(seconds=0.05), Delay(seconds=12.1)),
    "drift": (Drift(times=(0.0, 1.1, 3.0, 8.0), levels=(0.0, 0.5, -0.2, 0.1)), Drift(times=(0.0, 9.0), levels=(0.1, 0.3))),
    "feedback": (
        Feedback(forward=LAG, back=Polynomial(coefficients=(0.0, 0.3, 0.05))),
        Feedback(
            forward=Chain(chain=(LAG, Saturation(low=-0.6, high=0.5))), sign=1, back=Linear(num=(0.4,), den=(1.0, 1.0))
        ),
        Feedback(forward=Polynomial(coefficients=(0.0, 2.0, 0.0, 1.0)), solve="algebraic"),
        Feedback(forward=Chain(chain=(LAG, Saturation(low=-0.6, high=0.5))), back=LAG, solve="continuous"),
        Feedback(forward=RESONANT, back=Polynomial(coefficients=(0.0, 0.3, 0.05)), solve="continuous"),
        Feedback(forward=DeadZone(low=-0.2, high=0.3), back=Viscous(coefficient=2.0, negative=1.0), solve="algebraic"),
        Feedback(
            forward=Linear(num=(1.0, 0.5), den=(1.0, 2.0)),
            back=Polynomial(coefficients=(0.1, 1.0, 0.0, 0.5)),
            solve="algebraic",
        ),
    ),
    "kinked": (Kinked(coefficients=(0.1, 1.0), breaks=(-0.4, 0.5), kinks=((-0.7,), (0.6, -0.2))),),
    "gain_drift": (GainDrift(times=(0.0, 1.1, 3.0, 8.0), levels=(0.0, 0.5, -0.2, 0.1)),),
    "gain_step": (GainStep(at_s=2.4, height=0.3),),
    "hinge": (Hinge(at=0.3, slope=0.8),),
    "intersample": (Intersample(between="foh"), Intersample(between="bandlimited")),
    "jump": (Jump(at=-0.2, height=0.4),),
    "linear": (
        LAG,
        RESONANT,
        Linear(num=(2.0,), den=(4.0,)),
        Linear(num=(1.0,), den=(1.0, 4.0, 6.0, 4.0, 1.0)),  # a fourfold pole
        Linear(zeros=(-2.0,), poles=(-1.0 + 2.0j, -1.0 - 2.0j, -150.0), gain=300.0),  # |λ|·dt = 30
        Linear(A=((-1.0, 2.0), (-2.0, -1.0)), B=(1.0, 0.5), C=(0.3, 1.0), D=0.2),
        Linear(num=(0.5, 0.1), den=(1.0, -0.9, 0.4), dt=DT),
    ),
    "offset_step": (OffsetStep(at_s=2.4, height=0.3),),
    "oversampled": (
        Oversampled(
            factor=2,
            chain=(Linear(num=(0.5, 0.1), den=(1.0, -0.9, 0.4), dt=DT / 2), Polynomial(coefficients=(0.1, 1.0, 0.4))),
        ),
        Oversampled(factor=3, chain=(LAG, Spline(inputs=(-1.0, 0.0, 0.5), outputs=(-0.3, 0.2, 0.4)), RESONANT)),
    ),
    "parallel": (
        Parallel(parallel=(Viscous(coefficient=2.0), Coulomb(force=0.5), Constant(level=-0.3))),
        Parallel(parallel=(LAG, Chain(chain=(RESONANT, Saturation(low=-0.4, high=0.4))), Delay(seconds=0.33))),
    ),
    "piecewise": (
        Piecewise(breaks=(-0.6, 0.2, 0.9), pieces=((-1.0,), (0.5, 1.0), (0.0, 0.0, 2.0), (1.0, -0.5))),
        Piecewise(breaks=(-0.6, 0.2), pieces=((-0.1,), (0.5, 1.0), (0.68, 0.0, 0.5, 0.1)), knee=0.3),
    ),
    "polynomial": (
        Polynomial(coefficients=(0.2, 1.0, -0.3, 0.1)),
        Polynomial(coefficients=(2.0,)),
        Polynomial(coefficients=(0.2, 1.0, -0.3, 0.1), basis="chebyshev", domain=(-1.2, 1.5)),
    ),
    "preload": (Preload(offset=0.4, slope=0.8),),
    "quantizer": (Quantizer(step_=0.37), Quantizer(step_=0.05, mode="floor")),
    "relay": (Relay(low=-0.4, high=0.3, off=-1.0, on=2.0), Relay(low=0.09, high=0.1)),
    "saturation": (
        Saturation(low=-0.5, high=0.8, slope=1.3),
        Saturation(low=-0.5, high=0.8, slope=1.3, knee=0.5),
        Saturation(low=-0.1, high=0.2, slope=1.3, knee=0.5),  # the knees overlap
    ),
    "slew_limit": (SlewLimit(rate=1.1), SlewLimit(rate=6.0)),
    "spline": (
        Spline(inputs=(-0.9, -0.2, 0.3, 1.1), outputs=(-1.0, 0.1, 0.2, 0.9)),
        Spline(inputs=(-0.5, 0.6), outputs=(0.1, 1.0)),
    ),
    "table": (
        Table(inputs=(-1.0, -0.2, 0.4, 1.1), outputs=(-2.0, 0.0, 0.1, 0.9)),
        Table(inputs=(-1.0, -0.2, 0.4, 1.1), outputs=(-2.0, 0.0, 0.1, 0.9), beyond="hold"),
        Table(inputs=(-1.0, -0.2, 0.4, 1.1), outputs=(-2.0, 0.0, 0.1, 0.9), knee=0.35),
        Table(inputs=(-1.0, -0.2, 0.4, 1.1), outputs=(-2.0, 0.0, 0.1, 0.9), beyond="hold", knee=0.35),
    ),
    "tone": (Tone(omega=2.3, cos=(0.2, 0.05), sin=(-0.1, 0.02), harmonics=(1, 3)),),
    "viscous": (Viscous(coefficient=1.3), Viscous(coefficient=1.3, negative=0.6)),
}
