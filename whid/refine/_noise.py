"""The noise of every record as the residual shows it: its size, its colour, the weight of wild samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from whid.refine._problem import Problem
from whid.signal import Floats, rms
from whid.stages._whiten import autoregression, whitened

Noise = Literal["white", "ar"]
HUBER = 1.345  # of σ: 95 % efficient where the noise is Gaussian


def with_noise(problem: Problem, theta: Floats, noise: Noise, *, robust: bool) -> Problem:
    """Return the problem with each record's noise as its residual shows it."""
    data = []
    errors = problem.residuals(theta)
    if noise == "white" and not robust:
        std = by_record(
            problem, [d.periods * np.nansum(e**2) + d.scatter for d, e in zip(problem.data, errors, strict=True)]
        )
        return replace(problem, data=tuple(replace(d, std=max(std[d.record.name], 1e-300)) for d in problem.data))
    for d, e in zip(problem.data, errors, strict=True):
        ar = autoregression(e, d.use) if noise == "ar" else np.empty(0)
        white = whitened(np.where(d.use, e, 0.0)[:, None], d.use, ar)[:, 0]
        size = float(np.median(np.abs(white[d.use])) / 0.6745) if robust else rms(white[d.use])
        weight = np.sqrt(np.minimum(1.0, HUBER * size / np.maximum(np.abs(white), 1e-300))) if robust else None
        data.append(replace(d, ar=ar, std=max(size, 1e-300), weight=weight))
    return replace(problem, data=tuple(data))


def by_record(problem: Problem, squares: Sequence[float]) -> dict[str, float]:
    """Return the root mean square of every record, whose averaged parts stand apart in the problem."""
    total, samples = dict.fromkeys((d.record.name for d in problem.data), 0.0), samples_of(problem)
    for d, each in zip(problem.data, squares, strict=True):
        total[d.record.name] += float(each)
    return {name: float(np.sqrt(total[name] / samples[name])) for name in total}


def samples_of(problem: Problem) -> dict[str, int]:
    count = dict.fromkeys((d.record.name for d in problem.data), 0)
    for d in problem.data:
        count[d.record.name] += d.samples
    return count
