"""An example of every experiment part, for the contract tests."""

from whid.experiments._part import Part
from whid.experiments.hold import Hold
from whid.experiments.multisine import Multisine
from whid.experiments.noise_band import NoiseBand
from whid.experiments.sine import Sine
from whid.experiments.square import Square
from whid.experiments.staircase import Staircase
from whid.experiments.steps import Steps

EXAMPLES: dict[str, tuple[Part, ...]] = {
    "hold": (Hold(level=1.5, hold_s=3.0, use="report"),),
    "multisine": (
        Multisine(period=64, periods=3, lines=(1, 3, 8), rms=0.7, offset=1.0),
        Multisine(period=101, periods=2, lead_periods=0, band=(0.1, 0.5)),
    ),
    "noise_band": (NoiseBand(band=(0.39, 0.59), std=0.3, duration_s=50.0), NoiseBand(duration_s=5.1, offset=2.0)),
    "sine": (
        Sine(offset=2.0, amplitude=1.0, samples_per_period=(60.0, 30.0), periods=3),
        Sine(offset=0.0, amplitude=1.0, omega=(2.0, 5.0), periods=2, lead_periods=2),
    ),
    "square": (
        Square(offset=1.0, amplitude=2.0, period=10, periods=4),
        Square(amplitude=1.0, period=7, periods=1, duty=0.3),
    ),
    "staircase": (Staircase(from_=-1.0, to=1.0, step=0.5, hold_s=2.0, return_=True),),
    "steps": (
        Steps(low=-1.0, high=1.0, hold_s=(0.5, 2.0), duration_s=20.0),
        Steps(levels=(0.0, 1.0, -1.0), hold_s=0.7, duration_s=10.0, use="selection"),
    ),
}
