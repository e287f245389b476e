"""A joint refit of all free numbers and the effect's, from its best few starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Screened, Told
from whid.effects._look import Look
from whid.effects._sites import Sites
from whid.errors import WhidError
from whid.fit import Estimate
from whid.refine import refine
from whid.signal import Floats

ENTANGLED = 0.9999  # correlation: such numbers are a hundred times as uncertain together as one alone
FEW = 5  # iterations from where the fit on samples ended
MOST = 100  # iterations more, of a fit that is to stay
POLISH = 4  # rounds of halving steps over numbers without a derivative that leads


class Refit(NamedTuple):
    """A model with an effect, fitted."""

    effect: Effect
    candidate: Candidate  # at the fitted numbers
    look: Look
    estimate: Estimate
    chi2: float
    gain: float  # nats over the model without it, penalties paid
    selection: float = 0.0  # nats gained on the selection data
    selection_std: float = 0.0
    blocks: Floats = np.empty(0)  # of the selection data: the gain of each
    told: Told | None = None
    kept_back: float = 0.0  # nats that the selection data add to `gain`, where the noise was measured

    @property
    def evidence(self) -> float:
        """Return the nats gained on all samples but the report's: those that were fitted, and those that were predicted."""
        return self.gain + self.kept_back

    @property
    def entangled(self) -> bool:
        """Tell whether a number of the effect and one of the model only undo each other: a pair that data cannot part."""
        if self.told is not None:
            return False
        e, new = self.estimate, set(self.candidate.new)
        own = np.array([name in new for name in e.names])
        size = np.sqrt(np.diag(e.covariance))
        with np.errstate(divide="ignore", invalid="ignore"):
            correlation = np.abs(e.covariance / np.outer(size, size))[np.ix_(own, ~own)]
        return bool(np.any(correlation > ENTANGLED))


def refit(
    look: Look, starts: Sequence[Screened], enough: float = -np.inf, iterations: int = 25, *, known: bool = True
) -> Refit | None:
    """Return the best fit from several starts of one effect, None where none can be simulated.

    A loop is fitted on samples first, which costs a tenth, and between them only where that gains `enough` nats.
    known: the noise was measured. Else misfit passes for it, and its description weights a fit by what the model lacks: the
    prediction stays as it is.
    """
    quick = [each for start in starts if (each := _on_samples(look, start, iterations)) is not None]
    if quick:
        best = max(quick, key=lambda r: r.gain)
        if best.gain < enough:
            return best
        starts, iterations = [Screened(best.effect, best.candidate, best.gain)], FEW
    found = [each for start in starts if (each := _one(look, start, iterations, known)) is not None]
    return max(found, key=lambda r: r.gain, default=None)


def fitted(look: Look, iterations: int = 40, held: Sequence[str] = ()) -> tuple[Look, Estimate]:
    """Return the look at its own system after a fit of all its free numbers but the held ones."""
    if not look.system.tree.parameters():
        none = np.empty(0)
        return look, Estimate((), none, none, np.empty((0, 0)), 0, np.empty((0, 0)), look.chi2, look.samples, 0, "linear")
    found = refine(
        look.system, look.records, path=look.path, rates=look.rates, std=[n.std for n in look.noises],
        ar=[n.ar for n in look.noises], max_iterations=iterations, fixed=held,
    )  # fmt: skip
    if found.estimate.why_stop == "interrupted":
        raise KeyboardInterrupt
    return look.moved(found.system), found.estimate


def finished(refit: Refit) -> Refit:
    """Return a refit that the limit of its steps ended, fitted on; a loop, or numbers without a slope, as they are."""
    looped = Sites(refit.look.system, refit.look.core).looped
    if refit.estimate.why_stop != "iteration limit" or refit.candidate.rough or looped:
        return refit
    before = error2(refit.look)
    look, estimate = fitted(refit.look, MOST)
    chi2 = error2(look)
    gained = look.samples / 2 * float(np.log(before / max(chi2, 1e-300)))
    reached = refit.candidate._replace(system=look.system)
    done = estimate._replace(iterations=refit.estimate.iterations + estimate.iterations)
    return refit._replace(candidate=reached, look=look, estimate=done, chi2=chi2, gain=refit.gain + gained)


def _one(look: Look, start: Screened, iterations: int, known: bool) -> Refit | None:
    candidate = start.candidate
    if start.told is not None:
        return _noisier(look, start, start.told, iterations if known or start.told.hidden is not None else 0)
    try:
        rough = tuple(name for name, _ in candidate.rough)
        if rough:
            candidate = polished(look, candidate)
        after, estimate = fitted(look.moved(candidate.system, candidate.core), iterations, rough)
        if rough:
            candidate = polished(after, candidate._replace(system=after.system))
            after, _ = fitted(after.moved(candidate.system), iterations, rough)
            after, estimate = fitted(after, 0)  # the covariance of all of them
    except (WhidError, ValueError, np.linalg.LinAlgError):
        return None
    chi2 = error2(after)
    reached = candidate._replace(system=after.system)
    return Refit(start.effect, reached, after, estimate, chi2, gain_over(look, chi2, reached))


def _on_samples(look: Look, start: Screened, iterations: int) -> Refit | None:
    """Return a loop fitted on the sampled path, to the records shifted by what that path makes of the model without it.

    None where the candidate is no loop.
    """
    effect, candidate = start.effect, start.candidate
    if look.path != "exact" or start.told is not None or not Sites(candidate.system, candidate.core).looped:
        return None
    shifts = zip(look.records, look.sampled.predicted, look.predicted, strict=True)
    records = tuple(replace(r, y=r.y + near - exact) for r, near, exact in shifts)
    near = replace(look, records=records, path="sampled", _courses={})
    try:
        found, estimate = fitted(near.moved(candidate.system, candidate.core), iterations)
    except (WhidError, ValueError, np.linalg.LinAlgError):
        return None
    chi2, reached = error2(found), candidate._replace(system=found.system)
    return Refit(effect, reached, found, estimate, chi2, gain_over(look, chi2, reached))


def _noisier(look: Look, start: Screened, told: Told, iterations: int) -> Refit | None:
    """Return the model with a noise described, fitted again under it; samples that the noise spoiled leave the fit."""
    hidden = told.hidden or tuple(np.zeros(len(r), bool) for r in look.records)
    records = tuple(replace(r, valid=r.mask & ~h) for r, h in zip(look.records, hidden, strict=True))
    described = replace(look, records=records, noises=told.noises).moved(start.candidate.system, start.candidate.core)
    try:
        after, estimate = fitted(described, iterations)
    except (WhidError, ValueError, np.linalg.LinAlgError):
        return None
    return Refit(start.effect, start.candidate, after, estimate, error2(after), start.gain, told=told)


def gain_over(before: Look, chi2: float, candidate: Candidate) -> float:
    """Return the nats gained by a fall of the whole error's χ² to `chi2`, penalties paid."""
    n = before.samples
    likelihood = n / 2 * np.log(error2(before) / max(chi2, 1e-300))
    return float(likelihood + candidate.seen + candidate.beyond - candidate.penalty(n))


def error2(look: Look) -> float:
    """Return Σ of the whitened errors' squares, in units of σ²."""
    rows = look.rows([np.where(np.isfinite(e), e, 0.0)[:, None] for e in look.errors])[:, 0]
    return float(rows @ rows)


def polished(look: Look, candidate: Candidate) -> Candidate:
    """Return the candidate with its rough numbers searched, one after another, by steps that shrink."""
    best, cost = candidate, _cost(look, candidate)
    for turn in range(POLISH):
        for name, reach in candidate.rough:
            width = reach / 4**turn
            for step in (-width, -width / 2, -width / 4, width / 4, width / 2, width):
                try:
                    trial = best.at({name: best.values[name] + step})
                except WhidError:  # a border beyond its neighbour: no such block
                    continue
                if (reached := _cost(look, trial)) < cost:
                    best, cost = trial, reached
    return best


def _cost(look: Look, candidate: Candidate) -> float:
    """Return χ² left at the candidate, all other numbers absorbing what they can."""
    found = look.simulate(candidate.system)
    if found is None:
        return float("inf")
    errors: list[Floats] = [
        np.where(u, r.y - y, 0.0)[:, None] for r, y, u in zip(look.records, found, look.use, strict=True)
    ]
    left = look.rest(look.rows(errors))[:, 0]
    return float(left @ left)
