"""Small records with something that the declared model lacks, for the tests of the closed loop (seeds below 20000)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whid.blocks._block import Block
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.disturbances.white import White
from whid.experiments.multisine import Multisine
from whid.experiments.steps import Steps
from whid.predict import predict
from whid.record import Record
from whid.system import System

DT, STD = 0.1, 0.02
PLANT = System(
    chain=(
        Linear(num=(1.0,), den=(0.05, 0.4, 1.0)),
        Polynomial(coefficients=(0.0, 1.0, 0.2, -0.05)),
        Linear(num=(1.0,), den=(0.3, 1.0)),
    ),
    noise=(White(std=STD),),
)


def excitation(seed: int, period: int = 512, periods: int = 4) -> Record:
    """Return a plan: a multisine of some periods, random steps, and another multisine that nobody may look at."""
    rng = np.random.default_rng(seed)
    planned = (
        Multisine(period=period, periods=periods, rms=1.0, band=(0.0, 0.4)),
        Steps(low=-2.5, high=2.5, hold_s=(5 * DT, 60 * DT), duration_s=2 * period * DT),
        Multisine(period=period, periods=2, rms=1.0, band=(0.0, 0.4), use="report"),
    )
    parts, u, start = [], [], 0
    for part in planned:
        u.append(part.input(DT, rng))
        parts.append(part.placed(start, DT))
        start += len(u[-1])
    every = np.concatenate(u)
    return Record(u=every, y=np.zeros(len(every)), dt=DT, parts=tuple(parts))


def measured(system: System, seed: int, std: float = STD, plan: Record | None = None) -> Record:
    """Return what a system would give on a plan, with white noise."""
    plan = excitation(seed) if plan is None else plan
    noise = std * np.random.default_rng(seed + 1).standard_normal(len(plan))
    return replace(plan, y=predict(system.tree, plan) + noise)


def believed(system: System, seed: int, share: float = 0.1) -> System:
    """Return a system with every number wrong by up to a share: what a user would declare."""
    rng = np.random.default_rng(seed + 2)
    values = {p.name: p.value * (1 + share * rng.uniform(-1, 1)) for p in system.tree.parameters()}
    return replace(system, chain=system.tree.with_parameters(values).chain)


def lacking(place: int, block: Block) -> System:
    """Return the plant with a block that the declared model lacks."""
    return PLANT.inserted(place, block)
