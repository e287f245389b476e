"""What an answer of `whid trace` is worth, once the truth is opened beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from scipy.stats import binomtest

OUTCOMES = ("right", "equivalent", "wrong", "abstained", "missed", "failed")
CLASS = 3  # members of a class of equivalents that still says something


class Score(NamedTuple):
    """How one answer compares with its truth.

    outcome  right       the hidden effects, all of them and no other; of a control: nothing missing; of what is outside the
                         library: unattributed
             equivalent  ambiguous: the truth is in a reported class of at most three
             wrong       something else is named
             abstained   unattributed, or in a larger class
             missed      "nothing missing", where something is
             failed      no answer
    said     the names given, joined by +; the verdict where there are none
    over     after-error over the noise that is in the report samples
    """

    outcome: str
    said: str
    over: float
    seconds: float


def score(truth: Mapping[str, Any], answer: Mapping[str, Any] | None) -> Score:
    """Return the outcome of an answer; None is a run that failed."""
    if answer is None:
        return Score("failed", "", float("nan"), float("nan"))
    named = [(effect["kind"], effect["place"]) for effect in answer["effects"]]
    said = "+".join(f"{kind}@{place}" for kind, place in named) or answer["verdict"]
    after = answer["after"]["rms"] or float("nan")
    return Score(_outcome(truth, answer, named), said, after / truth["report_noise_rms"], float(answer["seconds"]))


def _outcome(truth: Mapping[str, Any], answer: Mapping[str, Any], named: Sequence[tuple[str, str]]) -> str:
    hidden, verdict = truth["effects"], answer["verdict"]
    if not hidden:
        return "right" if verdict == "nothing missing" else "wrong"
    if verdict == "nothing missing":
        return "missed"
    if verdict == "unattributed":
        return "right" if truth["outside"] else "abstained"
    if truth["outside"]:
        return "wrong"
    names = [{(e["kind"], place) for place in (e["place"], *e["alike"])} for e in hidden]
    if verdict == "explained" and len(named) == len(names) and all(each & {*named} for each in names):
        return "right"
    members = {*named, *((kind, place) for kind, place in answer["equivalent"])}
    if verdict != "ambiguous" or len(named) != len(names) or not all(each & members for each in names):
        return "wrong"
    return "equivalent" if len(members) - len(named) + 1 <= CLASS else "abstained"


def interval(hits: int, of: int) -> tuple[float, float]:
    """Return the exact 95 % binomial interval of a share.

    >>> tuple(round(x, 4) for x in interval(0, 200))
    (0.0, 0.0183)
    """
    found = binomtest(hits, of).proportion_ci(0.95, "exact")
    return float(found.low), float(found.high)
