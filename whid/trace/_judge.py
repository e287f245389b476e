"""What is said of the way the loop went: the residual at its start, the verdict at its end, then the report, once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from whid.effects._sites import Sites
from whid.signal import rms
from whid.system import System
from whid.trace._against import NEEDED
from whid.trace._measure import measured
from whid.trace._refit import Refit
from whid.trace._report import ResidualReport
from whid.trace._round import room
from whid.trace._state import Data, State
from whid.trace._terms import order
from whid.trace._unnamed import Unnamed, unnamed
from whid.trace._verdict import Errors, Found, Step, Verdict, Word

MOST = 0.5  # of what was left over: what the first of several effects must explain for all of them to be named
LOOP = 0.4  # of it: what a loop must, for anything to be looked for beside it
STRING = 3  # effects: so many are rarely missing at once
# of the nats that there are: a description without a name that gains so many, and more than what has one, stays
NEARLY = 0.7
ALMOST = 0.9  # of it: what all of them must, where the residual still answers to the input


def residual_report(state: State, data: Data) -> ResidualReport:
    """Return what a state leaves over and where it lives."""
    look, tests = state.look, state.gate.tests
    pairs = zip(data.closed, look.predicted, data.selection, strict=True)
    selection = np.concatenate([(r.y - p)[keep] for r, p, keep in pairs])
    errors = state.left
    std, origin = noise_level(state, data)
    return ResidualReport(
        rms(errors), rms(selection), std, origin, rms(errors) / std, state.gate.p, tuple(t.name for t in tests),
        np.array([t.statistic for t in tests]), np.array([t.p for t in tests]), tuple(t.where for t in tests),
        tuple(word for raw in data.raw for word in raw.words),
    )  # fmt: skip


def noise_level(last: State, data: Data) -> tuple[float, str]:
    """Return σ of the noise on y, and where it comes from."""
    if data.floor.dof:
        return data.floor.std, f"from the scatter of repeated periods, {data.floor.dof} degrees of freedom"
    return rms(last.left), "assumed: the last model's residual is taken for noise, since no period repeats"


def judged(states: Sequence[State], data: Data) -> Verdict:
    """Say what is missing, the report still closed."""
    first, last = states[0], states[-1]
    std, origin = noise_level(last, data)
    steps = states[1:]
    found = tuple(_found(s.added, _way(s)) for s in steps if s.added is not None)
    rivals = tuple((f.effect.kind, f.effect.place) for f in last.rivals) if steps else ()
    leads: tuple[Found, ...] = ()
    other = _outdone(states, data)
    word: Word
    if not steps and not first.dirty:
        word = "nothing missing"
        sentence = "nothing missing: the residual is noise, and no effect would pay for its numbers"
    elif not steps or other or _partial(states, std):
        word, leads, found, rivals = "unattributed", found, (), ()
        sentence = f"unattributed: {other.words if other else last.gate.words}"
        if leads:
            sentence += f"; leads, each a part only: {', '.join(f.name for f in leads)}"
    elif rivals:
        word = "ambiguous"
        sentence = f"ambiguous: {found[-1].name} or {' or '.join(f'{k}@{p}' for k, p in rivals)}"
    else:
        word, sentence = "explained", f"explained: {_in_words(found, steps, data)}"
    blank = Errors(*([float("nan")] * 6))
    return Verdict(
        word, sentence, found, rivals, leads, "", blank, blank, std, origin, first.gate.p, last.gate.p, (), float("nan")
    )


def _outdone(states: Sequence[State], data: Data) -> Unnamed | None:
    """Return what no effect does and yet explains more, by itself, than what was added; None where nothing does.

    More than all of it; or, where that is a string of effects, more than the first of them. Only where the noise was
    measured: else gains compare misfits. What the raw output shows is no rival of it.
    """
    added = [state.added for state in states if state.added is not None]
    if not data.floor.dof or not added or any(found.candidate.seen > 0 for found in added) or states[-1].rounded:
        return None
    best, gains = unnamed(states[0].look), [found.gain for found in added]
    return best if best.gain > NEEDED + (gains[0] if len(gains) >= STRING else sum(gains)) else None


def _in_words(found: Sequence[Found], steps: Sequence[State], data: Data) -> str:
    """Return what was found, an effect after another; noise that was measured nowhere is told for what it may be."""
    words = [f"{f.name} ({f.words})" if f.words else f.name for f in found]
    told = [s.added is not None and s.added.told is not None and not s.added.told.hidden for s in steps]
    if data.floor.dof or not any(told):
        return "; ".join(words)
    made = [w for w, noise in zip(words, told, strict=True) if not noise]
    noises = [w for w, noise in zip(words, told, strict=True) if noise]
    left = f"what is left over is described as {', '.join(noises)}: with nothing that repeats, noise and misfit look alike"
    return "; ".join([*made, left])


def astray(states: Sequence[State], data: Data) -> bool:
    """Tell whether going on is no use: most of what was left over is left over still, after two effects, or after a loop;
    or it has a description, but no name.

    A loop has numbers that soak up a part of nearly anything, and makes every further refit ten times as long.
    """
    last = states[-1]
    if not data.floor.dof or not last.dirty or len(states) < 2:
        return False
    other = _outdone(states, data)
    if other is not None and other.gain > NEARLY * room(states[0], data):
        return True
    several, looped = len(states) > 2, Sites(last.look.system, last.look.core).looped
    explained = _explained(states, noise_level(last, data)[0])[-1]
    return (several and explained < MOST) or (looped and explained < LOOP)


def _explained(states: Sequence[State], std: float) -> list[float]:
    """Return the share of what the declared model left beyond the noise that was explained at every state."""
    whole = states[0].excess(std)
    return [1 - state.excess(std) / whole if whole > 0 else 1.0 for state in states]


def _partial(states: Sequence[State], std: float) -> bool:
    """Tell whether what was added explains a part only: it left more than rests, or it is a string of small effects.

    Noise and what the raw output shows explain nothing that the input makes, and do not count.
    """
    explained = _explained(states, std)
    made = [k for k, s in enumerate(states) if s.added is not None and not s.added.told and not s.added.candidate.seen]
    if states[-1].rounded:
        return False
    if states[-1].dirty and explained[-1] < ALMOST:
        return True
    return len(made) > 2 and explained[made[0]] - explained[made[0] - 1] < MOST


def opened(verdict: Verdict, states: Sequence[State], data: Data, path: str) -> Verdict:
    """Return the verdict with the errors before and after: the one time that report data are looked at."""
    on = "report" if any(r.using("report").any() for r in data.records) else "estimation"
    kept = states if verdict.verdict in ("explained", "ambiguous") else states[:1]
    steps = tuple(
        Step(name, gain, on, measured(system, data.records, on, verdict.floor, path))
        for state in kept
        for name, gain, system in _named(state)
    )
    return verdict._replace(on=on, before=steps[0].errors, after=steps[-1].errors, steps=steps)


def _named(state: State) -> Iterator[tuple[str, float, System]]:
    """Yield what a state added, the nats that it gained and the model then: one step a term, where there are several."""
    added = state.added
    if added is None:
        yield "as declared, refitted", 0.0, state.look.system
        return
    way = _way(state)
    before = 0.0
    terms = order(way, added) if way else ("",)
    for term, each, system in zip(terms, (*way, added), (*_systems(state.way), state.look.system), strict=True):
        yield f"+ {added.effect.name}{term and ': '}{term}", each.gain - before, system
        before = each.gain


def _systems(states: Sequence[State]) -> tuple[System, ...]:
    return tuple(state.look.system for state in states)


def _way(state: State) -> tuple[Refit, ...]:
    return tuple(s.added for s in state.way if s.added is not None)


def _found(added: Refit, way: Sequence[Refit] = ()) -> Found:
    if added.told is not None:
        return Found(added.effect.kind, added.effect.place, added.told.numbers, added.told.std, added.gain)
    every, numbers = added.candidate.values, dict(added.candidate.terms)
    names = [name for term in order(way, added) for name in numbers[term]]
    values = {name: every[name] for name in (*names, *(n for n in every if n not in names))}
    std = dict(zip(added.estimate.names, added.estimate.std.tolist(), strict=True)) | dict(added.candidate.read)
    short = {
        name: ".".join(name.split(".")[-2:]) if name.split(".")[-1].isdecimal() else name.split(".")[-1] for name in values
    }
    return Found(
        added.effect.kind, added.effect.place, {short[n]: float(v) for n, v in values.items()},
        {short[n]: float(std.get(n, float("nan"))) for n in values}, added.gain,
    )  # fmt: skip
