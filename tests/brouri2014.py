"""Plants A1 and A2 for the second paper, which gives no numbers: input nonlinearity, linear block, output nonlinearity."""

from dataclasses import replace

import numpy as np

from whid.blocks.delay import Delay
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.blocks.polynomial import Polynomial
from whid.disturbances.white import White
from whid.experiments._experiment import Experiment
from whid.experiments.staircase import Staircase
from whid.methods._method import Answered, Wanted
from whid.methods.hammerstein_wiener import HammersteinWiener
from whid.simulate import simulate
from whid.system import System


def affine(breaks, slopes, left, range_=(-3.0, 3.0)):
    """Return pieces through (left end of each, value) with given slopes."""
    starts = (range_[0], *breaks)
    return Piecewise(
        breaks=tuple(breaks),
        pieces=tuple(
            (float(p - s * d), float(s)) if s else (float(p),) for d, s, p in zip(starts, slopes, left, strict=True)
        ),
    )


H1 = affine((-2.03, -0.61, 0.57, 1.63, 2.34), (0, 1, 0, 1.5, 0.6, 0), (-1.42, -1.42, 0, 0, 1.59, 2.016))
H2 = affine((-1.83, -0.47, 0.53, 1.46, 2.37), (0, 0.8, 0, 1, -0.5, 0), (-1.6, -1.4, 0, 0.4, 1.4, 1.2))
G1 = (Linear(num=(1.0,), den=tuple(np.convolve([1.0, 1.0], [0.25, 0.3, 1.0]))),)  # (s + 1)(0.25 s² + 0.3 s + 1)
G2 = (Linear(num=(1.2,), den=(0.5, 0.8, 1.0)), Delay(seconds=0.4))
F1 = Polynomial(coefficients=(0.0, 1.0, 0.3, 0.1))
F2 = Polynomial(coefficients=(0.0, 1.0, 0.9, 0.25))


def plant(which, std):
    """Return A1 or A2 with white output noise."""
    chain = {"A1": (H1, *G1, F1), "A2": (H2, *G2, F2)}[which]
    return System(chain=chain, noise=(White(std=std),))


def response(which, omega):
    """The true G(jω), from its formula."""
    s = 1j * np.asarray(omega)
    if which == "A1":
        return 1 / ((1 + s) * (1 + 0.3 * s + 0.25 * s**2))
    return 1.2 * np.exp(-0.4 * s) / (1 + 0.8 * s + 0.5 * s**2)


ANCHOR = 3  # the piece that is measured best in both plants, as a rule: its slope becomes 1


def normalised(which, anchor=ANCHOR):
    """Return the plant without noise in the model's scaling: slope 1 on the anchor, G(0) = 1."""
    h, f = {"A1": (H1, F1), "A2": (H2, F2)}[which]
    slope = h.pieces[anchor][1]
    scale = slope * {"A1": 1.0, "A2": 1.2}[which]
    pieces = tuple(tuple(c / slope for c in piece) for piece in h.pieces)
    linear = {"A1": G1, "A2": (Linear(num=(1.0,), den=(0.5, 0.8, 1.0)), Delay(seconds=0.4))}[which]
    stretched = Polynomial(coefficients=tuple(c * scale**k for k, c in enumerate(f.coefficients)))
    return System(chain=(Piecewise(breaks=h.breaks, pieces=pieces), *linear, stretched))


START = Experiment(dt=0.1, parts=(Staircase(from_=-3, to=3, step=0.1, hold_s=20, return_=True),))


def identify(which, std, seed, start=START, most=100, method=None):
    """Run the method on a simulated plant that answers up to `most` times; return (stages, records, plans)."""
    system, rng = plant(which, std), np.random.default_rng(seed)
    records, plans, stages = [simulate(system, start, rng)], [], []
    running = (method or HammersteinWiener())(records)
    answer = None
    try:
        while True:
            found, answer = running.send(answer), None
            if isinstance(found, Answered):
                continue
            if not isinstance(found, Wanted):
                stages.append(found)
                continue
            plans.append(found)
            if len(plans) <= most:
                answer = simulate(system, replace(start, parts=found.plan), rng)
                records.append(answer)
    except StopIteration:
        return stages, records, plans


def the(stages, name):
    """Return the last stage of a class."""
    return [s for s in stages if type(s).__name__ == name][-1]
