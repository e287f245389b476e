"""The borders of a piecewise f in a chain: where records want its jumps, where its pieces meet, what no record sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import polynomial as poly

from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.record import Record
from whid.refine import profile
from whid.system import System

PLACES = 24  # tried for a jump inside its gap: the cost has one narrow valley there


def held(system: System, place: int) -> tuple[str, ...]:
    """Return what a whole-record fit holds: static gains, and the jumps that it cannot see."""
    return unit_gain(system) + unseen_breaks(system, place)


def unit_gain(system: System) -> tuple[str, ...]:
    """Return the constant terms of the linear blocks, which hold their static gain, and the places of a table's points."""
    held = []
    for k, block in enumerate(system.chain):
        if isinstance(block, Linear) and block.num is not None and block.den is not None:
            held += [f"chain.{k}.num.{len(block.num) - 1}", f"chain.{k}.den.{len(block.den) - 1}"]
        elif block.kind == "table":
            held.append(f"chain.{k}.inputs")
    return tuple(held)


def unseen_breaks(system: System, place: int) -> tuple[str, ...]:
    """Return the jumps that no transition passes: f comes first in the chain, where a held input steps over them."""
    f = system.chain[place] if place == 0 else None
    return tuple(f"chain.0.breaks.{k}" for k in np.flatnonzero(~f.kinks())) if isinstance(f, Piecewise) else ()


def located(
    system: System, records: Sequence[Record], place: int, which: Sequence[int] = (), away: float = np.nan
) -> System:
    """Return the system with every jump (or `which` breaks) where the record wants it in its gap, not near `away`."""
    f = system.chain[place]
    assert isinstance(f, Piecewise)
    for k in which or np.flatnonzero(~f.kinks()).tolist():
        low, high = gap(f, records, k)
        places = low + (high - low) * (np.arange(PLACES) + 0.5) / PLACES
        places = places[~(np.abs(places - away) < (high - low) / PLACES)]
        cost = profile(system, records, f"chain.{place}.breaks.{k}", places)
        f = replace(f, breaks=(*f.breaks[:k], float(places[np.argmin(cost)]), *f.breaks[k + 1 :]))
        system = replaced(system, place, f)
    return system


def gap(f: Piecewise, records: Sequence[Record], k: int) -> tuple[float, float]:
    """Return the levels on either side of a break, or the neighbouring breaks where these are nearer."""
    levels = np.unique([part.level for record in records for part in record.select("hold")])  # type: ignore[attr-defined]
    marks = np.concatenate([levels, f.breaks[:k], f.breaks[k + 1 :]])
    below, above = marks[marks <= f.breaks[k]], marks[marks > f.breaks[k]]
    width = float(np.diff(levels).max(initial=0.0)) or 1.0
    low = float(below.max()) if len(below) else f.breaks[k] - width
    return low, float(above.min()) if len(above) else f.breaks[k] + width


def met(f: Piecewise, k: int, low: float, high: float) -> Piecewise | None:
    """Return f with its pieces meeting at break k, in or beside its gap; None where they do not come together there."""
    roots = poly.polyroots(poly.polytrim(poly.polysub(f.pieces[k + 1], f.pieces[k])))
    roots = roots[np.abs(np.imag(roots)) < 1e-9].real
    near = roots[(roots > 2 * low - high) & (roots < 2 * high - low)]
    if not len(near):
        return None
    b = float(near[np.argmin(np.abs(near - f.breaks[k]))])
    step = float(poly.polyval(b, f.pieces[k]) - poly.polyval(b, f.pieces[k + 1]))
    right = (f.pieces[k + 1][0] + step, *f.pieces[k + 1][1:])
    breaks = (*f.breaks[:k], b, *f.breaks[k + 1 :])
    if any(later <= earlier for earlier, later in pairwise(breaks)):
        return None
    return replace(f, breaks=breaks, pieces=(*f.pieces[: k + 1], right, *f.pieces[k + 2 :]))


def replaced(system: System, place: int, f: Piecewise) -> System:
    """Return the system with another f."""
    return replace(system, chain=(*system.chain[:place], f, *system.chain[place + 1 :]))
