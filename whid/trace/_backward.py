"""The step back: an earlier effect that a later one made redundant is dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from whid.trace._against import NEEDED
from whid.trace._gate import gate
from whid.trace._refit import error2, refit
from whid.trace._round import STARTS
from whid.trace._state import State


def backward(states: Sequence[State]) -> list[State]:
    """Return the states on the way, without an earlier effect that the last one alone makes redundant."""
    whole = list(states)
    last = states[-1].added
    if len(states) < 3 or last is None or last.told is not None:
        return whole
    for k in range(len(states) - 2, 0, -1):
        added = states[k].added
        if added is None or added.told is not None or added.candidate.seen > 0:
            continue  # noise takes no number of the model; what the raw output shows stays
        before, both = states[k - 1].look, states[-1].look
        starts = last.effect.screen(before)
        alone = refit(before, starts[:STARTS]) if starts else None
        if alone is not None and error2(replace(alone.look, noises=both.noises, _courses={})) - error2(both) < 2 * NEEDED:
            return [*states[:k], State(alone.look, alone.estimate, gate(alone.look), alone)]
    return whole
