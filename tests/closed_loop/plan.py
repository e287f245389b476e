"""The experiment of a closed-loop case: a staircase up and down, sines and a multisine with repeats, steps kept aside."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tests.closed_loop.fine import Floats


class Plan(NamedTuple):
    """The input, the `parts:` a user would write for it, and which samples are for estimation."""

    u: Floats
    dt: float
    parts: list[dict[str, Any]]
    estimation: np.ndarray
    low: float
    high: float


def draw_plan(rng: np.random.Generator, slowest: float, dt: float) -> Plan:
    """Return a plan of some 9 500 samples for a plant whose slowest time constant is `slowest` samples."""
    half = float(np.round(rng.uniform(1.0, 4.0), 1))
    centre = float(np.round(rng.uniform(-0.2, 0.2) * half, 2))
    low, high = round(centre - half, 6), round(centre + half, 6)
    hold = int(np.clip(round(6 * slowest), 60, 120))
    count = int(rng.integers(11, 14))
    step = round(2 * half / (count - 1), 4)
    levels = low + step * np.arange(count)
    way = np.concatenate([levels, levels[-2::-1]])
    u: list[Floats] = []
    parts: list[dict[str, Any]] = []
    start = 0

    def part(samples: Floats, **entry: Any) -> None:
        nonlocal start
        parts.append({"kind": entry.pop("kind"), "start": start, **entry})
        u.append(samples)
        start += len(samples)

    ends = {"from": low, "to": round(low + step * (count - 1), 6), "step": step}
    part(np.repeat(way, hold), kind="staircase", **ends, hold_s=round(hold * dt, 9), **{"return": True})
    for periods, share, cycles in (([160, 80, 40], 0.55, 6), ([120, 60, 30], 0.3, 7)):
        amplitude = round(half * share, 3)
        offset = round(centre + rng.uniform(-0.9, 0.9) * (half - amplitude), 3)
        wave = [offset + amplitude * np.cos(2 * np.pi * np.arange((cycles + 1) * p) / p) for p in periods]
        part(
            np.concatenate(wave), kind="sine", offset=offset, amplitude=amplitude, samples_per_period=periods,
            periods=cycles, lead_periods=1,
        )  # fmt: skip
    wave = multisine(rng, 256, np.arange(1, 33), 0.85 * half, centre)
    part(np.tile(wave, 7), kind="multisine", stop=start + 7 * 256, period=256)
    steps = random_steps(rng, 1200, low, high)
    part(steps, kind="steps", stop=start + 1200, use="report")
    wave = multisine(rng, 200, np.arange(1, 21), 0.8 * half, centre)
    part(np.tile(wave, 4), kind="multisine", stop=start + 800, period=200, use="report")
    whole = np.concatenate(u).astype(np.float32).astype(float)  # what the file holds
    estimation = np.zeros(len(whole), bool)
    estimation[: start - 2000] = True
    return Plan(whole, dt, parts, estimation, float(whole.min()), float(whole.max()))


def multisine(rng: np.random.Generator, period: int, lines: np.ndarray, peak: float, offset: float) -> Floats:
    """Return a period of a random-phase multisine whose peak is `peak` about the offset."""
    n = np.arange(period)
    wave = np.cos(2 * np.pi * np.outer(n, lines) / period + rng.uniform(0, 2 * np.pi, len(lines))).sum(axis=1)
    return offset + peak * wave / np.abs(wave).max()


def random_steps(rng: np.random.Generator, samples: int, low: float, high: float) -> Floats:
    """Return random levels, each held for 10 to 60 samples."""
    holds = rng.integers(10, 61, samples // 10 + 1)
    return np.repeat(rng.uniform(low, high, len(holds)), holds)[:samples]
