"""Levels that a staircase method asks for: in the gaps of borders, and on pieces that too few levels describe."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Any

import numpy as np

from whid.experiments.hold import Hold
from whid.methods._method import Answered, Wanted
from whid.record import Record
from whid.stages.bisection import Bisection, side, wide
from whid.stages.levels import StaticCurve
from whid.stages.more_levels import more_levels
from whid.stages.segmentation import Segmentation

Read = Callable[[Sequence[Record]], tuple[StaticCurve, Segmentation]]
Asking = Generator[Any, Record | None, tuple[list[Record], list[str]]]


def ask_levels(records: Sequence[Record], curve: StaticCurve, pieces: Segmentation, read: Read, max_degree: int) -> Asking:
    """Ask for levels in the gaps of borders until they are narrow, then for those that pieces lack, once.

    curve, pieces: what the records show so far; read: what they show with more.
    Returns the records that answered, and what was asked in vain. Source [PAPERS A, build 3].
    """
    new, vain = yield from _bisect(records, curve, pieces, read)
    if new:
        curve, pieces = read([*records, *new])
    more, said = yield from _fill([*records, *new], curve, pieces, read, max_degree)
    return [*new, *more], [*vain, *said]


def _fill(records: Sequence[Record], curve: StaticCurve, pieces: Segmentation, read: Read, max_degree: int) -> Asking:
    """Ask once for the levels without which a piece's degree cannot be told."""
    level, f_std = more_levels(pieces, curve.level, float(np.median(curve.mean_std)), max_degree)
    if not len(level):
        return [], []
    where = ", ".join(f"{u:.4g}" for u in level)
    reason = f"too few levels to tell the degree of f about {where}"
    hold_s = _hold(records)
    plan = tuple(Hold(level=float(u), hold_s=hold_s) for u in level)
    answer = yield Wanted(plan, reason, float(np.sqrt(np.mean(f_std**2))), "f at these levels, output")
    if answer is None:
        return [], [f"{reason}: no more were measured"]
    _, found = read([*records, answer])
    before, after = (", ".join(map(str, each.degrees)) for each in (pieces, found))
    yield Answered(f"degrees {after}" + ("" if before == after else f", which were read as {before}"))
    return [answer], []


def _bisect(records: Sequence[Record], curve: StaticCurve, pieces: Segmentation, read: Read) -> Asking:
    """Halve the gaps of all borders at once, one level a border and round."""
    span, std = float(np.ptp(curve.level)), float(np.median(curve.mean_std))
    unclear = wide(pieces, span, std)
    gaps = pieces.borders.copy()
    count, sure = np.zeros(len(gaps), int), np.ones(len(gaps), bool)
    new: list[Record] = []
    vain: list[str] = []
    while active := [k for k in wide(pieces._replace(borders=gaps), span, std) if sure[k]]:
        middle = gaps[active].mean(axis=1)
        where = ", ".join(f"{low:.6g} … {high:.6g}" for low, high in gaps[active])
        reason = f"f has a border somewhere in {where}: a level in the middle"
        predicted = float(np.diff(gaps[active], axis=1).max()) / 2 / np.sqrt(12)
        hold_s = _hold(records)
        plan = tuple(Hold(level=float(u), hold_s=hold_s) for u in middle)
        answer = yield Wanted(plan, reason, predicted, "a border of f, input")
        if answer is None:
            vain.append(f"where f has its border within {where}: no level in the middle was measured")
            break
        new.append(answer)
        curve, _ = read([*records, *new])
        for k, u in zip(active, middle, strict=True):
            at = int(np.flatnonzero(np.isclose(curve.level, u, rtol=0, atol=1e-9 * span))[-1])
            way = side(pieces, k, float(u), float(curve.mean[at]), float(curve.mean_std[at]))
            sure[k] = way != 0
            gaps[k, 0 if way < 0 else 1] = u if way else gaps[k, 0 if way < 0 else 1]
            count[k] += 1
        yield Answered("borders in " + ", ".join(f"{low:.6g} … {high:.6g}" for low, high in gaps[active]))
    if new:
        yield Bisection(pieces.borders[unclear], gaps[unclear], count[unclear], sure[unclear])
    return new, vain


def _hold(records: Sequence[Record]) -> float:
    """Return how long a level is held, s."""
    return float(np.median([record.dt * part.length for record in records for part in record.select("hold")]))
