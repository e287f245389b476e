"""Design P of the first paper: plant, plan, and noisy records that share one noise-free simulation."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.record import Record
from whid.simulate import simulate
from whid.system import System

STD = 0.5
PLANT = System(
    chain=(
        Linear(num=(0.04,), den=(1.0, 0.5, 0.04)),
        Piecewise(
            breaks=(-2.4, -0.8, 0.8, 3.2),
            pieces=((-200.0,), (-50.0, 62.5), (0.0,), (-25.0, 0.0, 31.25), (160.0, 12.5)),
        ),
        Linear(num=(0.1,), den=(1.0, 0.7, 0.1)),
    )
)
PLAN = Experiment(
    dt=np.pi / 6,
    parts=(
        Staircase(from_=-3.5, to=4.0, step=0.5, hold_s=200.0),
        Sine(offset=2.0, amplitude=1.0, samples_per_period=(600.0, 300.0, 200.0), periods=20),
    ),
)


def front(omega):
    """The true front block, static gain 1, from its poles."""
    s = 1j * np.asarray(omega)
    return 0.04 / ((s + 0.4) * (s + 0.1))


def back(omega):
    """The true back block, static gain 1, from its poles."""
    s = 1j * np.asarray(omega)
    return 0.1 / ((s + 0.2) * (s + 0.5))


@lru_cache
def clean() -> Record:
    """The record without noise."""
    return simulate(PLANT, PLAN, np.random.default_rng(0))


def record(seed: int) -> Record:
    """The record with white noise of the paper's size."""
    quiet = clean()
    return replace(quiet, y=quiet.y + STD * np.random.default_rng(seed).standard_normal(len(quiet)))
