"""An effect of several terms, one after another: which explains most by itself, which most of what is left then."""

from __future__ import annotations

from collections.abc import Sequence

from whid.effects._effect import Screened
from whid.effects._look import Look
from whid.trace._refit import Refit, refit


def by_terms(look: Look, starts: Sequence[Screened], whole: Refit) -> tuple[Refit, ...]:
    """Return the refits on the way to an effect with all its terms: with the best one, the best two, … but for the last.

    starts  every choice of terms that was screened, with the same look as `whole`
    """
    wanted = {name for name, _ in whole.candidate.terms}
    way: list[Refit] = []
    have: set[str] = set()
    while len(have) < len(wanted) - 1:
        more = [s for s in starts if have < _terms(s) < wanted and len(_terms(s)) == len(have) + 1]
        fits = [found for s in more if (found := refit(look, [s])) is not None]
        if not fits:
            break
        way.append(max(fits, key=lambda f: f.gain))
        have = {name for name, _ in way[-1].candidate.terms}
    return tuple(way)


def order(way: Sequence[Refit], whole: Refit) -> tuple[str, ...]:
    """Return the names of the terms in the order in which they came."""
    names: list[str] = []
    for each in (*way, whole):
        names += [name for name, _ in each.candidate.terms if name not in names]
    return tuple(names)


def _terms(start: Screened) -> set[str]:
    return {name for name, _ in start.candidate.terms}
