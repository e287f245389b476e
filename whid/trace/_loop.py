"""The closed loop: what is left over, what would explain it, add it, again; then the verdict, and only then the report."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

from whid.effects._effect import Effect
from whid.methods._method import Model
from whid.record import Record
from whid.system import System
from whid.trace._backward import backward
from whid.trace._base import base
from whid.trace._judge import judged, opened, residual_report
from whid.trace._left_over import left_over
from whid.trace._options import Trace
from whid.trace._round import one_round
from whid.trace._state import Data, State, data_of

QUIET = 0.01  # p of the gate above which effects of the input are not looked for again
OF_TIME = (
    "drift", "gain_drift", "offset_step", "gain_step", "hum", "outliers", "dropouts", "quantizer", "jitter",
    "coloured_noise", "process_noise", "level_noise",
)  # fmt: skip


def trace(system: System, records: Sequence[Record], options: Trace, path: str = "exact") -> Iterator[Any]:
    """Yield the residual report, the ranking of every round, the verdict, and last the refined Model.

    system   the declared tree: its structure counts, its numbers are start values
    records  with their report samples: these are looked at once, when the verdict is frozen
    """
    began = time.perf_counter()
    data = data_of(system, records)
    states = [base(system, data, path)]
    yield residual_report(states[0], data)
    for effects in _leading(options, data):
        ranking, state = one_round(states[-1], effects, data)
        if state is not None and _leads(state):
            yield ranking
            states = [*states, state]
    for _ in range(options.rounds + 1 - len(states)):
        ranking, state = one_round(states[-1], _competing(states, options, data), data)
        yield ranking
        if state is None:
            break
        states = backward([*states, state])
    verdict = judged(states, data)
    last = states[-1] if verdict.verdict in ("explained", "ambiguous") else states[0]
    yield left_over(data.closed, states[0].look, last.look, verdict.floor)
    yield opened(verdict, states, data, path)._replace(seconds=time.perf_counter() - began)
    yield Model(last.look.system, last.estimate, "none")


def _leading(options: Trace, data: Data) -> Iterator[tuple[Effect, ...]]:
    """Yield what is tried before everything else: what the raw output shows, then the input between its samples.

    A wrong course between samples is a delay of about half a sample, which other effects would take on.
    """
    every = options.every()
    if any(raw.railed for raw in data.raw):
        yield tuple(e for e in every if e.name == "saturation@output")
    yield tuple(e for e in every if e.name == "intersample@time")


def _leads(state: State) -> bool:
    """Tell whether what came first may stay ahead of all others: the raw output shows it, or it leaves nothing behind."""
    return state.added is not None and (state.added.candidate.seen > 0 or not state.dirty)


def _competing(states: Sequence[State], options: Trace, data: Data) -> tuple[Effect, ...]:
    """Return the effects of a round: once nothing answers to the input, what is left lives in time, or is noise."""
    effects = options.every()
    if not data.floor.dof and any(s.added is not None and s.added.told and not s.added.told.hidden for s in states):
        effects = tuple(
            e for e in effects if e.place != "noise" and e.kind not in ("jitter", "outliers")
        )  # misfit is described once
    if len(states) == 1 or states[-1].gate.p <= QUIET:
        return effects
    return tuple(e for e in effects if e.place in ("noise", "output", "time") and e.kind in OF_TIME)
