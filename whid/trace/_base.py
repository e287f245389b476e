"""The declared model, fitted: its structure is trusted, its numbers are start values."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from whid.effects._look import Look, Noise
from whid.errors import WhidError
from whid.fit import Estimate
from whid.system import System
from whid.trace._forensics import without_suspects
from whid.trace._gate import gate
from whid.trace._mend import across, at, jumps, searched, tried
from whid.trace._refit import Refit, error2, fitted
from whid.trace._state import Data, State, with_noise

STUCK = 1.5  # of the noise's variance: such a base fit is tried again from other starts
ASIDE = 1.1  # of it, where a curve jumps: the fit may have stopped beside the jump
SCATTERED = 3  # of them


def base(system: System, data: Data, path: str) -> State:
    """Return the declared model fitted, the noise with it: to what the raw output gives no reason to doubt.

    What is left over is then looked at on every sample: what hangs, stands alone or meets a rail is for effects to explain.
    """
    known = data.floor.dof > 0
    noise = Noise(data.floor.innovation, tuple(data.floor.ar)) if known else Noise()
    count = len(data.seen)
    look, estimate = fitted(
        Look(system, without_suspects(data.seen, data.raw), (noise,) * count, (0, len(system.series)), path)
    )
    if known and error2(look) > (ASIDE if jumps(look) else STUCK) * look.samples:
        look, estimate = _best_of(system, look, estimate)
    if not known:
        for _ in range(3 if data.coloured else 1):
            look = with_noise(look, data.coloured)
            look, estimate = fitted(look)
    if any(raw.suspect.any() for raw in data.raw):
        look = replace(look, records=data.seen, _courses={})
        look = look if known else with_noise(look, data.coloured)
    return State(look, estimate, gate(look))


def better(first: State, found: Refit) -> State | None:
    """Return the declared model fitted from the numbers that it has beside an effect, None where its own fit was no worse.

    No effect can make the declared numbers alone explain more than their own fit did, unless that had stopped at a wrong
    place: the effect was then what moved them on.
    """
    look, new = first.look, set(found.candidate.new)
    names = [p.name for p in look.system.tree.parameters()]
    values = [p.value for p in found.look.system.tree.parameters() if p.name not in new]
    if found.told or len(names) != len(values) or any(n.ar for n in look.noises) != any(n.ar for n in found.look.noises):
        return None
    try:
        there = look.moved(at(look.system, dict(zip(names, values, strict=True))))
        if error2(there) >= error2(look):
            return None
        look, estimate = fitted(there)
    except (WhidError, ValueError, np.linalg.LinAlgError):
        return None
    return State(look, estimate, gate(look))


def _best_of(system: System, look: Look, estimate: Estimate) -> tuple[Look, Estimate]:
    """Return the best fit from other starts: a gross error may be a fit that stopped at a wrong place.

    Breakpoints are searched without derivatives, all other numbers absorbing what they can; jumps are stepped over; then all
    numbers are scattered.
    """
    found = [tried(start, look) for start in (across, searched)]
    rng = np.random.default_rng(SCATTERED)
    for _ in range(SCATTERED):
        free = system.tree.parameters()
        factors = 1 + 0.1 * rng.standard_normal(len(free))
        moved = {p.name: float(np.clip(p.value * f, p.lower, p.upper)) for p, f in zip(free, factors, strict=True)}
        found.append(tried(partial(Look.moved, system=at(system, moved)), look))
    return min([(look, estimate), *(each for each in found if each)], key=lambda each: error2(each[0]))
