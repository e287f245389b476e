"""The Cramér-Rao bound of a sweep's cells: the least scatter that an unbiased estimate from these experiments can have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from whid.config.study import Study
from whid.errors import WhidError
from whid.fit import Estimate
from whid.record import Record
from whid.refine import bound
from whid.score import true_value
from whid.signal import Floats
from whid.simulate import simulate
from whid.system import System

PLANS = 20  # different plants and experiments; beyond, the bounds of a sweep would cost more than its cells
Told = Mapping[object, tuple[System, Estimate]]  # plants without noise, and their numbers, by plant and experiment


def told(studies: Sequence[Study]) -> Told:
    """Return what the experiments tell of all numbers of their true plants, for noise of unit standard deviation."""
    found: dict[object, tuple[System, Estimate]] = {}
    for study in studies:
        if _std(study) is None or len(found) >= PLANS or (plan := _plan(study)) in found:
            continue
        with suppress(WhidError, ValueError, np.linalg.LinAlgError):  # a plant that has no tangents
            found[plan] = _unit(study)
    return found


def bounds(known: Told, studies: Sequence[Study], metrics: Sequence[str]) -> dict[str, Floats]:
    """Return the bound of every metric in every cell, {metric: (cells,)}; nothing where it is not known.

    std(metric) ≥ sqrt(gᵀ (σ⁻² JᵀJ)⁻¹ g), J the tangents of ŷ with respect to all numbers of the true plant, g the metric's
    gradient. Known for one white noise at the output; NaN in a cell with another one.
    Source [Kay 1993, Fundamentals of Statistical Signal Processing: Estimation Theory], section 3.8.
    """
    unit = {plan: np.array([_of(*numbers, name) for name in metrics]) for plan, numbers in known.items()}
    found = np.full((len(metrics), len(studies)), np.nan)
    for c, study in enumerate(studies):
        std = _std(study)
        if std is not None and (plan := _plan(study)) in unit:
            found[:, c] = std * unit[plan]
    return {name: row for name, row in zip(metrics, found, strict=True) if np.isfinite(row).any()}


def _plan(study: Study) -> object:
    return (study.plant.chain if study.plant else (), study.experiment)


def _std(study: Study) -> float | None:
    noise = study.plant.noise if study.plant else ()
    white = len(noise) == 1 and noise[0].kind == "white" and noise[0].place == "output"
    return noise[0].std if white else None


def _unit(study: Study) -> tuple[System, Estimate]:
    assert study.plant is not None
    silent = replace(study.plant, noise=())
    records = [simulate(silent, each, np.random.default_rng(study.seed)) for each in study.experiment]
    return silent, bound(silent, [_hidden(record) for record in records], [1.0] * len(records))


def _hidden(record: Record) -> Record:
    return record.without("report") if record.using("report").any() else record


def _of(system: System, estimate: Estimate, metric: str) -> float:
    """Return sqrt(gᵀ C g), g by central differences; infinite where the metric moves along what the plan does not show."""
    numbers = zip(estimate.names, estimate.values.tolist(), strict=True)
    gradient = np.array([_slope(system, metric, name, value) for name, value in numbers])
    lost = np.isinf(estimate.std) & (np.abs(gradient) > 1e-9)
    seen = np.isfinite(estimate.std)
    g = gradient[seen]
    return float("inf") if lost.any() else float(np.sqrt(g @ estimate.covariance[np.ix_(seen, seen)] @ g))


def _slope(system: System, metric: str, name: str, value: float) -> float:
    step = 1e-6 * max(abs(value), 1e-6)
    moved = (system.tree.with_parameters({name: value + sign * step}).chain for sign in (1, -1))
    up, down = (true_value(replace(system, chain=chain), metric) for chain in moved)
    return (up - down) / (2 * step)
