"""What speaks against a refit, however much it gains."""

from __future__ import annotations

import numpy as np

from whid.trace._gate import gate
from whid.trace._refit import Refit, error2
from whid.trace._state import Data, State

NEEDED = 10.0  # nats that an effect must gain beyond its penalty
BORNE_OUT = 2.0  # standard errors that a gain on selection data must reach where nothing repeats
GROWN = 10.0  # times as uncertain as before: what an entangled effect makes of a number of the model


def against(found: Refit, here: State, data: Data, other: float) -> str:
    """Return what speaks against a refit, in words; empty: nothing.

    Where nothing else measures the noise, selection data must bear a refit out: a gain that is no chance. They lie between
    what was fitted, and a free course goes through there as well: it must leave nothing that answers to the input, else it
    may be what the input does, followed in time. So it is where the past of the input or of the output explains more
    (`other`, nats; see `_unnamed`).
    """
    if found.look.path != here.look.path:
        return "did less on samples"
    if _vetoed(found):
        return "vetoed"
    if _entangled(found, here):
        return "undoes a number of the model"
    if found.candidate.free and found.gain < other:
        return "the past explains more"
    if data.floor.dof or found.told is not None or found.candidate.seen > NEEDED:
        return ""
    if found.selection <= BORNE_OUT * found.selection_std:
        return "not borne out"
    return "may be the input, followed in time" if found.candidate.free and not clean(found) else ""


def _vetoed(found: Refit) -> bool:
    """Tell whether selection data speak against a refit: a loss that chance would not make.

    Not against what the raw record shows without a model.
    """
    if found.candidate.seen > NEEDED:
        return False
    expected = found.selection_std**2 / 2
    return found.selection < -1.0 and found.selection < expected - 2.5 * found.selection_std


def _entangled(found: Refit, here: State) -> bool:
    """Tell whether a refit's effect and a number of the model only undo each other, and did not before it came.

    Numbers that share a scale which the data hardly fix (a gain between two blocks) are correlated, too: no worse for it.
    """
    if not found.entangled:
        return False
    new = set(found.candidate.new)
    before, after = (dict(zip(e.names, e.std.tolist(), strict=True)) for e in (here.estimate, found.estimate))
    old_names = [p.name for p in here.look.system.tree.parameters()]
    own_names = [p.name for p in found.look.system.tree.parameters() if p.name not in new]
    if len(old_names) != len(own_names):
        return True
    nan = float("nan")
    shrunk = np.sqrt(found.chi2 / error2(here.look))  # as much better the model explains, as much surer its numbers look
    pairs = [(before.get(a, nan), after.get(b, nan)) for a, b in zip(old_names, own_names, strict=True)]
    grown = [new_std * shrunk / old for old, new_std in pairs if old > 0 and np.isfinite(old) and np.isfinite(new_std)]
    return max(grown, default=np.inf) > GROWN


def clean(found: Refit) -> bool:
    """Tell whether a refit leaves nothing that answers to the input."""
    tested = gate(found.look)
    return tested.p >= tested.threshold
