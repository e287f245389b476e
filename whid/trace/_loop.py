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
from whid.trace._base import base, better
from whid.trace._deciding import deciding
from whid.trace._judge import astray, judged, opened, residual_report
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

    Before the verdict, where it is ambiguous, the experiment that would decide (`Wanted`).

    system   the declared tree: its structure counts, its numbers are start values
    records  with their report samples: these are looked at once, when the verdict is frozen
    """
    began = time.perf_counter()
    data = data_of(system, records)
    states = [base(system, data, path)]
    yield residual_report(states[0], data)
    for effect in _shown(options, data):
        if (found := one_round(states[-1], (effect,), data)).state is not None:
            yield found.ranking
            states = [*states, found.state]
    for _ in range(options.rounds + 1 - len(states)):
        before = [s.added for s in states if s.added is not None]
        ranking, state = one_round(states[-1], _competing(states, options, data), data, before)
        yield ranking
        if state is None:
            break
        if len(states) == 1 and state.added and data.floor.dof and (mended := better(states[0], state.added)):
            states = [mended]
            yield residual_report(mended, data)
            continue
        states = backward([*states, state])
        if states[-1].rounded or astray(states, data):
            break
    verdict = judged(states, data)
    if verdict.verdict == "ambiguous":
        wanted = deciding(states[-1], verdict.floor)
        if wanted is not None:
            yield wanted
        told = f"this experiment would tell them apart: {wanted.reason}" if wanted else "no experiment here would"
        verdict = verdict._replace(sentence=f"{verdict.sentence}; {told}")
    last = states[-1] if verdict.verdict in ("explained", "ambiguous") else states[0]
    yield left_over(data.closed, states[0].look, last.look, verdict.floor)
    yield opened(verdict, states, data, path)._replace(seconds=time.perf_counter() - began)
    yield Model(last.look.system, last.estimate, "none")


def _shown(options: Trace, data: Data) -> tuple[Effect, ...]:
    """Return what is tried before everything else, for the raw output shows it: the clip at its rails, samples that hang."""
    shown = {
        "saturation@output": any(raw.railed for raw in data.raw),
        "dropouts@output": any(raw.frozen.any() for raw in data.raw),
    }
    return tuple(e for e in options.every() if shown.get(e.name))


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
