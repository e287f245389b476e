"""What the loop works on: the records as each of its parts may see them, and the model so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from whid.disturbances.rounding import Rounding
from whid.effects._look import Look, Noise
from whid.fit import Estimate
from whid.record import Record
from whid.signal import Floats, rms
from whid.stages._whiten import autoregression, whitened
from whid.system import System
from whid.trace._floor import Floor, floor
from whid.trace._forensics import Raw, forensics
from whid.trace._gate import Gate, gate
from whid.trace._refit import Refit, finished, fitted
from whid.trace._selection import Bools, cut

ROUNDED = 0.8  # of the residual's rms


class Data(NamedTuple):
    """The records and who may see what of them.

    records    all of it; only `measured` looks at report samples, when the verdict is frozen
    closed     without report samples, records that are all report left out
    seen       without selection samples too: what is fitted
    selection  where the samples that rank are
    coloured   the declared noise has a memory
    raw        what the outputs show without a model, one a record
    """

    records: tuple[Record, ...]
    closed: tuple[Record, ...]
    seen: tuple[Record, ...]
    selection: tuple[Bools, ...]
    floor: Floor
    coloured: bool
    raw: tuple[Raw, ...]


def data_of(system: System, records: Sequence[Record]) -> Data:
    """Return records parted by use, with the noise that their repeated periods show."""
    closed = [r.without("report") if r.using("report").any() else r for r in records]
    closed = [r for r in closed if (r.using("estimation") | r.using("selection")).any()]
    seen, selection = cut(closed)
    coloured = any(noise.kind == "ar" for noise in system.noise)
    return Data(tuple(records), tuple(closed), seen, selection, floor(closed, coloured), coloured, forensics(system, closed))


class State(NamedTuple):
    """The model so far, what was added last, and what this record cannot tell from it."""

    look: Look
    estimate: Estimate
    gate: Gate
    added: Refit | None = None
    rivals: tuple[Refit, ...] = ()
    way: tuple[State, ...] = ()  # to it, where the effect has several terms: one state a term, all but the last

    @property
    def dirty(self) -> bool:
        """Tell whether the residual answers to the input."""
        return self.gate.p < self.gate.threshold

    @property
    def left(self) -> Floats:
        """Return the residual of all records at the samples that count."""
        return np.concatenate([e[np.isfinite(e)] for e in self.look.errors])

    @property
    def rounded(self) -> bool:
        """Tell whether a converter's steps, found by now, make nearly all that is left: finer things cannot be seen."""
        rounding = [noise for noise in self.look.system.noise if isinstance(noise, Rounding)]
        return any(float(noise.std or 0.0) > ROUNDED * rms(self.left) for noise in rounding)

    def excess(self, std: float) -> float:
        """Return the mean square of the residual beyond a noise of this σ."""
        return max(rms(self.left) ** 2 - std**2, 0.0)


def reached(refit: Refit, data: Data, rivals: tuple[Refit, ...] = ()) -> State:
    """Return the state of a model with an effect added; where nothing repeats its residual is the noise from now on.

    That residual must then be the best that the model can do: a fit that the limit of its steps ended goes on.
    """
    if data.floor.dof or refit.told:
        return State(refit.look, refit.estimate, gate(refit.look), refit, rivals)
    refit = finished(refit._replace(look=with_noise(refit.look, data.coloured)))
    look, found = fitted(with_noise(refit.look, data.coloured), 0)  # the same numbers, as sure as they are now
    estimate = found._replace(why_stop=refit.estimate.why_stop, iterations=refit.estimate.iterations)
    return State(look, estimate, gate(look), refit._replace(estimate=estimate), rivals)


def with_noise(look: Look, coloured: bool) -> Look:
    """Return the look with each record's noise as its residual shows it."""
    noises = []
    for error, use, noise in zip(look.errors, look.use, look.noises, strict=True):
        ar = autoregression(error, use) if coloured or noise.ar else np.empty(0)
        white = whitened(np.where(use, error, 0.0)[:, None], use, ar)[:, 0]
        shape = np.ones(len(use)) if noise.shape is None else noise.shape
        noises.append(Noise(max(rms(white[use] / shape[use]), 1e-300), tuple(ar), noise.shape))
    return replace(look, noises=tuple(noises), _courses={})
