"""One round: screen every effect, refit the best few, say which is to be added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from whid.effects._effect import Effect, Screened
from whid.effects._look import Look
from whid.signal import Floats, rms
from whid.stages._whiten import whitened
from whid.trace._against import NEEDED, against, clean
from whid.trace._mend import mended
from whid.trace._refit import Refit, error2, refit
from whid.trace._report import Ranking
from whid.trace._selection import Bools
from whid.trace._state import Data, State, reached
from whid.trace._terms import by_terms
from whid.trace._unnamed import unnamed

WORTH = 0.03  # of what the effects before it gained, where the noise was measured: less is how an effect was described
ONCE = 0.2  # of what described the noise before: a description that gains less mends the one that is there
FINALISTS = 4  # effects that are refitted in a round
STARTS = 2  # of each
CERTAIN = ("dropouts", "quantizer")  # seen without a model
SHORT = 5.0  # nats that a refit may add to a score: what falls short of what is needed by more is not refitted
NEAR = 0.95  # of the best gain: a loop that gains less on samples is not fitted between them
BEHIND = 0.25  # of the best score: what promises less is not refitted
BLOCKS = 10  # of few stretches of selection data, whose gains scatter as the standard error says
FEW = 5  # stretches below which they are cut: the misfit of one level of a staircase is one number, in two halves the same
COURSES = ("drift", "gain_drift", "offset_step")  # in time, whatever the input does
ASSUMED = "intersample@time"
CLASS = 4.0  # nats: refits closer than this to the best cannot be told from it,
ALIKE = 6.0  # standard errors: if what they predict differs by no more


class Round(NamedTuple):
    """What competed, and the model with what won; None: nothing pays for its numbers."""

    ranking: Ranking
    state: State | None


def one_round(here: State, effects: Sequence[Effect], data: Data, before: Sequence[Refit] = ()) -> Round:
    """Screen everything, refit the best few, and say which is to be added; `before`: what was added already."""
    look, beyond = here.look, max(NEEDED, _worth(before, data))
    first = data.floor.dof > 0 and not before

    def needed(start: Screened | Refit) -> float:
        """Return the nats that it must gain: more than chance does, beside others more than a flaw of their description."""
        return _by_chance(start, look.samples, len(effects)) if first else beyond

    described = ONCE * sum(f.gain for f in before if f.told and not f.told.hidden)
    known = data.floor.dof > 0
    other = unnamed(look).gain if known else -np.inf
    screened = (_counted(e.screen(look), here, data) for e in effects)
    ranked = sorted(filter(None, screened), key=lambda s: (not _ahead(s[0]), -s[0].gain))
    fits: list[Refit] = []
    said: dict[str, str] = {}  # against every refit
    for starts in ranked:
        start = starts[0]
        if start.told is not None and start.effect.kind not in CERTAIN and here.dirty and start.gain < 2 * room(here, data):
            continue  # what answers to the input is no noise
        best = max(fits, key=lambda f: f.gain, default=None)
        if len(fits) == FINALISTS or (best and best.gain > needed(best) and start.gain < BEHIND * best.gain):
            break
        if start.gain < min(needed(start), NEEDED) - SHORT:
            continue
        if _late(start, here, data) and any(not said[f.effect.name] and f.gain > needed(f) for f in fits):
            continue  # it would come after these
        enough = max(NEAR * best.gain - NEEDED, other) if best and known else other
        found = refit(look, starts[: 1 if best and clean(best) else STARTS], enough, known=known)
        if found is None:
            continue
        if known and not found.told and found.gain > needed(found) and (best is None or found.gain > BEHIND * best.gain):
            found = found if clean(found) else mended(look, found)
        fits.append(found if found.told else _on_selection(look, found, data))
        said[found.effect.name] = against(fits[-1], here, data, other)
    good = [f for f in fits if not said[f.effect.name]]
    good = _assumed_first(_in_order(good, data, dirty=here.dirty))
    good = [f for f in good if not f.told or f.told.hidden or f.gain > described]
    taken = next((f for f in good if f.evidence > needed(f)), None)
    asked = needed(taken or good[0]) if good else beyond
    ranking = _ranking(ranked, fits, said, taken, good, asked)
    if taken is None:
        return Round(ranking, None)
    near = (f for f in good if f is not taken and taken.evidence - f.evidence < CLASS and taken.effect.name != ASSUMED)
    rivals = tuple(f for f in near if _alike(taken, f))
    state = reached(taken, data, rivals)
    if len(taken.candidate.terms) > 1:
        starts = next(starts for starts in ranked if starts[0].effect.name == taken.effect.name)
        state = state._replace(way=tuple(reached(each, data) for each in by_terms(look, starts, taken)))
    return Round(ranking, state)


def _by_chance(start: Screened | Refit, samples: int, effects: int) -> float:
    told = start.told
    if told is not None:  # its likelihood's gain is χ² like that of an edit with as many numbers
        return start.candidate._replace(new=tuple(told.numbers)).chance(samples, effects)
    return start.candidate.chance(samples, effects)


def _counted(starts: Sequence[Screened], here: State, data: Data) -> list[Screened]:
    """Return starts by what counts of their gain: a walk tells noise from noise, and what answers to the input is none.

    Where nothing repeats and the residual still answers to the input, a course is worth what its points explain.
    """
    if data.floor.dof or not here.dirty:
        return list(starts)
    return sorted((_without_walk(start, here.look.samples) for start in starts), key=lambda s: -s.gain)


def _without_walk(start: Screened, samples: int) -> Screened:
    walked, plain = start.candidate, start.candidate._replace(paid=None, beyond=0.0)
    gain = start.gain - walked.beyond + walked.penalty(samples) - plain.penalty(samples)
    return start if walked.paid is None else start._replace(candidate=plain, gain=gain)


def _worth(before: Sequence[Refit], data: Data) -> float:
    """Return the nats below which an effect is how those before it were described, and not another one.

    Only where the noise was measured: gains are then in units of it, and against what is far above it a small flaw of a
    description gains a lot. Where nothing repeats the noise is what is left, less of it after every effect, and selection
    data bear an effect out or do not.
    """
    if not data.floor.dof:
        return 0.0
    return WORTH * sum(f.evidence for f in before if not f.told and not f.candidate.seen)


def _ahead(first: Screened) -> bool:
    """Tell whether a start is refitted before all others: a wrong assumption about the input between its samples."""
    return first.effect.name == ASSUMED and first.gain > NEEDED


def _assumed_first(good: list[Refit]) -> list[Refit]:
    """Return refits, a wrong assumption about the input first where nothing explains more.

    It is a delay of about half a sample, which other effects could take on; but it is a mismatch of what was declared, and
    no effect of the plant, and costs no number.
    """
    return sorted(good, key=lambda f: not (f.effect.name == ASSUMED and good[0].evidence - f.evidence < CLASS))


def _in_order(fits: Sequence[Refit], data: Data, *, dirty: bool) -> list[Refit]:
    """Return refits, the best first: by likelihood where the noise was measured.

    Where no period repeats, the last model's misfit passes for noise and likelihoods compare misfits: a free course in
    time fits any of them. Then the gain on selection data decides, and where that does not, the fewer numbers. And while
    the residual answers to the input, what answers to the input comes before a course in time, which predicts nothing.
    """
    by_gain = sorted(fits, key=lambda f: -f.evidence)
    if data.floor.dof or not fits or any(f.told for f in fits):
        return by_gain
    best = max(fits, key=lambda f: f.selection)

    def worse(f: Refit) -> bool:
        return f is not best and best.selection - f.selection > _scatter(best.blocks - f.blocks)

    return sorted(by_gain, key=lambda f: (dirty and f.effect.kind in COURSES, worse(f), len(f.candidate.new)))


def _alike(one: Refit, other: Refit) -> bool:
    """Tell whether what two refits predict differs by no more than noise hides: √Σδ²/σ², δ = ŷ_A − ŷ_B.

    A description of noise leaves the prediction as it is: only likelihood parts it from others.
    """
    if one.told or other.told:
        return True
    delta = [(a - b)[:, None] for a, b in zip(one.look.predicted, other.look.predicted, strict=True)]
    return float(np.linalg.norm(one.look.rows(delta))) < ALIKE


def room(here: State, data: Data) -> float:
    """Return the nats that an effect without any chance in it could gain at most: the residual brought down to the floor."""
    if not data.floor.dof:
        return float("inf")
    return here.look.samples * float(np.log(max(rms(here.left) / data.floor.std, 1.0)))


def _on_selection(before: Look, found: Refit, data: Data) -> Refit:
    """Return the refit with its gain on selection data, that gain's standard error, and the gains of blocks of them.

    Where the noise was measured: Σ (e₀² − e₁²)/2σ², with the standard error that white noise makes. Where misfit passes for
    it, every model predicts with a σ of its own, that of its misfit on the estimation data:
    Σ log(σ₀/σ₁) + e₀²/2σ₀² − e₁²/2σ₁²; and as misfits next to each other are not independent, the standard error is what the
    gains of blocks scatter by.
    """
    known = data.floor.dof > 0
    ratio = 1.0 if known else float(np.sqrt(max(found.chi2 / error2(before), 1e-300)))  # σ₁/σ₀
    gains, change2, squares = [], 0.0, np.zeros(2)
    for r, old, new, keep, noise in zip(
        data.closed, before.predicted, found.look.predicted, data.selection, found.look.noises, strict=True
    ):
        columns = np.stack([r.y - old, r.y - new], axis=1)
        white = whitened(np.where(keep[:, None], columns, 0.0), keep, np.array(noise.ar))[keep] / noise.std
        gains += _in_blocks(-np.log(ratio) + (white[:, 0] ** 2 - (white[:, 1] / ratio) ** 2) / 2, keep)
        change2 += float(np.sum((white[:, 0] - white[:, 1]) ** 2))
        squares += np.sum(white**2, axis=0)
    blocks = np.array(gains)
    std = float(np.sqrt(change2)) if known else _scatter(blocks)
    kept_back = _kept_back(before, found.chi2, squares, sum(int(keep.sum()) for keep in data.selection)) if known else 0.0
    return found._replace(selection=float(blocks.sum()), selection_std=std, blocks=blocks, kept_back=kept_back)


def _kept_back(before: Look, after: float, squares: Floats, count: int) -> float:
    """Return what selection data add to the nats gained: n/2·log(χ²₀/χ²₁) of all samples, less that of the fitted ones."""
    n, old = before.samples, error2(before)
    whole = (n + count) / 2 * np.log((old + squares[0]) / max(after + squares[1], 1e-300))
    return float(whole - n / 2 * np.log(old / max(after, 1e-300)))


def _in_blocks(gain: Floats, keep: Bools) -> list[float]:
    """Return gains at the samples that rank, summed over every stretch of them, less than FEW in BLOCKS pieces."""
    stretches = np.split(gain, np.flatnonzero(np.diff(np.flatnonzero(keep)) > 1) + 1)
    pieces = 1 if len(stretches) >= FEW else -(-BLOCKS // len(stretches))
    return [float(part.sum()) for stretch in stretches for part in np.array_split(stretch, pieces) if len(part)]


def _scatter(blocks: Floats) -> float:
    """Return the standard error of a sum of independent blocks, from their scatter."""
    return float(np.std(blocks, ddof=1) * np.sqrt(len(blocks))) if len(blocks) > 1 else float("inf")


def _late(first: Screened, here: State, data: Data) -> bool:
    """Tell whether a start comes after all others that stand (see `_in_order`)."""
    return not data.floor.dof and here.dirty and first.effect.kind in COURSES


def _ranking(
    ranked: Sequence[Sequence[Screened]], fits: Sequence[Refit], against: Mapping[str, str], taken: Refit | None,
    good: Sequence[Refit], needed: float,
) -> Ranking:  # fmt: skip
    by_name = {f.effect.name: f for f in fits}
    rows = sorted(
        ranked, key=lambda s: -(by_name[s[0].effect.name].evidence if s[0].effect.name in by_name else s[0].gain - 1e9)
    )
    names = tuple(s[0].effect.name for s in rows)
    n = taken.look.samples if taken else (fits[0].look.samples if fits else 1)

    def column(value: Any) -> Floats:
        return np.array([value(by_name.get(s[0].effect.name), s[0]) for s in rows], float)

    nan = float("nan")
    count = column(lambda f, s: len(s.candidate.new))
    tried = column(lambda f, s: s.candidate.tried)
    return Ranking(
        names, count, tried, column(lambda f, s: s.told.penalty if s.told else s.candidate.penalty(n)),
        column(lambda f, s: s.gain),
        column(lambda f, s: f.gain if f else nan), column(lambda f, s: f.selection if f else nan),
        column(lambda f, s: f.selection_std if f else nan), tuple(against.get(name, "") for name in names),
        taken.effect.name if taken else "",
        good[0].evidence - (good[1].evidence if len(good) > 1 else 0.0) if good else nan, needed,
    )  # fmt: skip
