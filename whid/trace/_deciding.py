"""The experiment that would tell apart what a record cannot: where the refitted models differ most, in standard errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from whid.effects._look import sensitivities
from whid.errors import WhidError
from whid.experiments._part import Part
from whid.experiments.sine import Sine
from whid.experiments.staircase import Staircase
from whid.methods._method import Wanted
from whid.record import Record
from whid.refine import past
from whid.signal import Floats, rms
from whid.trace._refit import Refit
from whid.trace._round import COURSES
from whid.trace._state import State

SAMPLES = 2000  # of every experiment that is compared, about
PERIODS = 6  # lengths of a period that are compared, from SHORTEST to a quarter of the samples
SHORTEST = 8  # samples
STEPS = 8  # of a staircase
HOLDS = (1, 4)  # times as long
FAR = 1e3  # times the range of y: what a course in time may be like when the experiment is run


class Deciding(NamedTuple):
    """An experiment, and how far apart the models are there.

    separation  √(δᵀ(σ²I + Σ J C Jᵀ)⁻¹δ): standard errors, the numbers of both models as uncertain as the records leave them
    difference  rms of δ = ŷ_A − ŷ_B, as fitted
    """

    part: Part
    separation: float
    difference: float
    samples: int


def deciding(last: State, sigma: float) -> Wanted | None:
    """Return the experiment that parts the last effect from its rivals best, the nearest rival counted; None: no such.

    Sines of several periods, amplitudes and offsets and staircases up and down are compared, all of about the same length
    and within the range of the input so far. σ (output units) is that of white noise. A description of noise makes no
    difference to ŷ: no experiment is named for it.
    """
    rivals = [rival for rival in last.rivals if rival.told is None]
    if last.added is None or last.added.told is not None or not rivals:
        return None
    best: Deciding | None = None
    for part in _parts(last.look.records):
        found = min(
            (each for rival in rivals if (each := _apart(last.added, rival, part, sigma))),
            key=lambda d: d.separation,
            default=None,
        )
        if found is not None and (best is None or found.separation > best.separation):
            best = found
    if best is None or not best.separation > 0:
        return None
    names = " and ".join(f"{r.effect.name}" for r in rivals)
    reason = (
        f"{in_words(best.part)}: {last.added.effect.name} and {names} differ there by {best.separation:.3g} standard errors"
    )
    return Wanted((best.part,), reason, best.difference / best.separation, f"a difference of {best.difference:.3g}")


def in_words(part: Part) -> str:
    """Return an experiment as it is told to a person."""
    if isinstance(part, Sine):
        return (
            f"a sine of {part.samples_per_period:g} samples a period, amplitude {part.amplitude:.4g} "
            f"about {part.offset:.4g}, {part.periods} periods"
        )
    assert isinstance(part, Staircase)
    return (
        f"a staircase from {part.from_:.4g} to {part.to:.4g} and back in steps of {part.step:.4g}, {part.hold_s:.4g} s each"
    )


def _parts(records: Sequence[Record]) -> Iterator[Part]:
    """Yield experiments within the range of the input so far."""
    u = np.concatenate([r.u for r in records])
    low, high = float(np.nanmin(u)), float(np.nanmax(u))
    middle, half = (low + high) / 2, (high - low) / 2
    if not half > 0:
        return
    for period in np.unique(np.geomspace(SHORTEST, SAMPLES / 4, PERIODS).round()):
        for share in (1.0, 0.5, 0.25):
            for offset in (middle,) if share == 1.0 else (middle, middle - (1 - share) * half, middle + (1 - share) * half):
                periods = max(int(SAMPLES // period) - 1, 1)
                yield Sine(offset=offset, amplitude=share * half, samples_per_period=float(period), periods=periods)
    dt = records[0].dt
    for longer in HOLDS:
        step = (high - low) * longer / STEPS / 2
        hold = SAMPLES * longer / (4 * STEPS)
        yield Staircase(from_=low, to=high, step=step, hold_s=float(round(hold) * dt), return_=True)


def _apart(one: Refit, other: Refit, part: Part, sigma: float) -> Deciding | None:
    """Return how far apart two fitted models are on an experiment."""
    record = _planned(part, one.look.records[0])
    try:
        (y, spread), (z, more) = (_predicted(each, record) for each in (one, other))
    except (WhidError, ValueError, np.linalg.LinAlgError, OverflowError):
        return None
    delta, lead = y - z, _lead(part)
    wide = np.concatenate([spread, more], axis=1)[lead:] / sigma
    apart = delta[lead:] / sigma
    if not (np.all(np.isfinite(apart)) and np.all(np.isfinite(wide))):
        return None
    inner = wide.T @ apart
    square = float(apart @ apart - inner @ np.linalg.solve(np.eye(wide.shape[1]) + wide.T @ wide, inner))
    return Deciding(part, float(np.sqrt(max(square, 0.0))), rms(delta[lead:]), len(record))


def _predicted(found: Refit, record: Record) -> tuple[Floats, Floats]:
    """Return ŷ (N,) and columns (N, p) whose squares add up to what the numbers' errors make of it.

    A course in time says nothing of the time of the experiment: an unknown offset and trend take its place.
    """
    system = found.look.system
    course = found.effect.kind in COURSES
    if course:
        system = found.candidate.at(dict.fromkeys(found.candidate.amplitude, 0.0)).system
    estimate = found.estimate
    names = [name for name in estimate.names if not (course and name in found.candidate.new)]
    path = found.look.path
    y, j = sensitivities(system.tree, record, names, path, past(system.tree, record, path))
    at = [estimate.names.index(name) for name in names]
    known = np.isfinite(estimate.std[at])
    inner = [place for place, use in zip(at, known, strict=True) if use]
    values, vectors = np.linalg.eigh(estimate.covariance[np.ix_(inner, inner)])
    free = j[:, ~known] * float(np.ptp(record.u))  # what the records do not tell may be anything within the range
    columns = np.column_stack([j[:, known] @ (vectors * np.sqrt(np.maximum(values, 0.0))), free])
    if course:
        time = np.linspace(-1, 1, len(y))
        far = FAR * float(np.ptp(y) or 1.0)
        columns = np.column_stack([columns, far * np.ones(len(y)), far * time])
    return y, columns


def _planned(part: Part, like: Record) -> Record:
    """Return the record that an experiment would make, its output unknown."""
    rng = np.random.default_rng(0)  # nothing in these parts is random
    u = np.concatenate([each.input(like.dt, rng) for each in part.expand(like.dt)])
    return replace(like, u=u, y=np.full(len(u), np.nan), valid=None, t0=0.0, parts=(), initial="steady", name="deciding")


def _lead(part: Part) -> int:
    return round(float(part.samples_per_period or 0)) * part.lead_periods if isinstance(part, Sine) else 0  # type: ignore[arg-type]
