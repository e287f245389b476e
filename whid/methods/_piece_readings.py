"""Readings of the pieces: found, told apart by all samples where the levels cannot, and fitted to every sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.methods import _piece_plans as plans
from whid.methods._audit import audit
from whid.methods._method import Answered, Model, Stages, Wanted
from whid.methods._piece_bench import PERIODS, Asking, Bench
from whid.methods._pieces_model import held_names, model_of
from whid.record import Record, time_constants
from whid.refine import Refined, refine
from whid.residual import residual
from whid.signal import rms
from whid.stages._affine_fit import AffineFit
from whid.stages._whiten import autoregression
from whid.stages.input_pieces import Choice, InputPieces, input_pieces
from whid.stages.transfer_function import TransferFunction, transfer_function
from whid.system import System

MOST_SAMPLES = 400_000  # of a whole-record fit that nobody asked for; settled sines are averaged in it
MORE = 0.05  # residual variance beyond the noise of the levels that calls for a word
WORSE = 1.001  # residual of the whole-record fit over that of its start


class Reading(NamedTuple):
    """One way to read the pieces: h, the joint fit behind it, G."""

    pieces: InputPieces
    fit: AffineFit
    linear: TransferFunction


def read(bench: Bench, known: Choice, first: AffineFit, forced: dict[int, tuple[float, float]] | None = None) -> Reading:
    """Return h from all levels and sines, and G from the joint fit's response."""
    pieces, fit = input_pieces(first, known, forced)
    m = len(fit.omegas)
    own = slice(len(pieces.estimate.values) - 2 * m, None)
    values, covariance = pieces.estimate.values[own], pieces.estimate.covariance[own, own]
    order = np.append(np.arange(0, 2 * m, 2), np.arange(1, 2 * m, 2))
    linear = transfer_function(
        fit.omegas,
        values[::2],
        values[1::2],
        covariance[np.ix_(order, order)],
        bench.samples,
        shown=time_constants(bench.records),
    )
    return Reading(pieces, fit, linear)


def audited(bench: Bench, known: Choice, first: AffineFit, best: Reading) -> Asking:
    """Let all samples decide between readings of the pieces; ask for square waves where they cannot."""
    pieces = best.pieces
    readings = [best]
    for j in range(pieces.rivals.shape[1]):
        other = np.isfinite(pieces.rivals[:, j])
        value = np.where(other, pieces.rivals[:, j], pieces.value)
        slope = np.where(other, pieces.rival_slopes[:, j], pieces.slope)
        forced = {k: (float(value[k]), float(slope[k])) for k in range(len(value)) if k != pieces.anchor}
        readings.append(read(bench, known, first, forced))
    models = [model_of(*reading) for reading in readings]
    values, slopes = (np.array([getattr(reading.pieces, name) for reading in readings]) for name in ("value", "slope"))
    verdict = audit(models, values, slopes, bench.records)
    if not verdict.decided:
        plan = plans.squares(pieces, best.linear, bench.lead, bench.dt, PERIODS)
        reason = f"which of {len(readings)} readings of {len(plan)} pieces that the levels cannot tell apart"
        error = float(bench.curve.noise_std * np.sqrt(2 / sum(part.period * PERIODS for part in plan)))
        answer = yield Wanted(plan, reason, error, "harmonic, output")
        if answer is not None:
            bench.records.append(answer)
            verdict = audit(models, values, slopes, bench.records)
            yield Answered("decided" if verdict.decided else "not decided")
    yield verdict
    if not verdict.decided:
        return best
    chosen = readings[verdict.chosen]
    none = np.empty((len(pieces.centre), 0))
    return chosen._replace(pieces=chosen.pieces._replace(rivals=none, rival_slopes=none))


def finished(bench: Bench, reading: Reading, staged: Model, wanted: bool | None) -> Stages:
    """Yield the whole-record fit, where it is wanted, and the Model."""
    missing = (*staged.missing, *reading.pieces.unknown(), *_unexplained(bench, staged))
    if not (bench.samples <= MOST_SAMPLES if wanted is None else wanted):
        yield staged._replace(missing=missing)
        return
    try:
        best = _refined(bench.records, staged, reading)
    except (WhidError, ValueError, np.linalg.LinAlgError) as fault:  # the stages before it still stand
        yield staged._replace(missing=(*missing, f"the whole-record fit failed: {fault}"))
        return
    yield best
    missing = (*staged.missing, *reading.pieces.unknown(), *_unexplained(bench, staged._replace(system=best.system)))
    before, after = (_left(bench, system) for system in (staged.system, best.system))
    if after > WORSE * before:
        yield staged._replace(missing=(*missing, "the whole-record fit found no minimum: these are the staged numbers"))
        return
    yield staged._replace(system=best.system, estimate=best.estimate, missing=missing + best.gauge)
    if best.estimate.why_stop == "interrupted":
        raise KeyboardInterrupt


def _left(bench: Bench, system: System) -> float:
    """Return the rms of all records' residual."""
    return rms(np.concatenate([residual(system.tree, record) for record in bench.records]))


def _unexplained(bench: Bench, model: Model) -> tuple[str, ...]:
    """Return which record is left with more than the noise that its levels have."""
    worst = ("", 1.0)
    for record in bench.records:
        left = residual(model.system.tree, record)[record.using("estimation")]
        ratio = (rms(left) / max(bench.curve.noise_std, 1e-300)) ** 2
        if ratio > 1 + max(MORE, 6 * np.sqrt(2 / max(len(left), 1))) and ratio > worst[1]:
            worst = (record.name, ratio)
    if not worst[0]:
        return ()
    return (
        f"record {worst[0]} is not explained: its residual is {np.sqrt(worst[1]):.3g} times the noise of the levels: a "
        "piece not resolved, or read wrongly (hold longer, average more periods), or a system with more than this structure",
    )


def _refined(records: Sequence[Record], staged: Model, reading: Reading) -> Refined:
    """Fit all numbers to all samples; once more, prewhitened, where the longest record's residual is coloured.

    A jump of the first block in the chain moves no sample until it passes one: its place is held in its gap.
    """
    jumps = tuple(f"chain.0.breaks.{k}" for k in np.flatnonzero(reading.pieces.jump))
    held = held_names(staged.system, reading.pieces.anchor) + jumps
    found = refine(staged.system, records, fixed=held, periodic=True)
    longest = max(records, key=len)
    left = residual(found.system.tree, longest)
    colour = autoregression(left, longest.using("estimation") & np.isfinite(left))
    if found.estimate.why_stop == "interrupted" or not len(colour):
        return found
    return refine(found.system, records, fixed=held, noise="ar")
