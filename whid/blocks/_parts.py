"""All panels of a signal in time order, cut where the signal turns round or where a block asks for it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from whid.blocks._split import turning
from whid.signal import NO_SPLITS, Floats, Ints, Panels, Splits, at, rule

LEAST = 1e-14  # of an interval: what is narrower is no panel


class Cut(NamedTuple):
    """Panels after a cut: each a stretch of the panel `owner`, from `begin` on in that one's own coordinate."""

    parts: Splits
    owner: Ints
    begin: Floats


def every(panels: Panels) -> Splits:
    """Return all panels in time order, sub-panels in place of the intervals that they tile."""
    s, n = panels.splits, panels.values.shape[-1]
    if not len(s.interval):
        return Splits(np.arange(n), np.zeros(n), np.ones(n), panels.values)
    whole = np.ones(n, bool)
    whole[s.interval] = False
    dense = np.flatnonzero(whole)
    index = np.concatenate([dense, s.interval])
    order = np.argsort(index + np.concatenate([np.zeros(len(dense)), s.start]), kind="stable")
    begin, width = np.concatenate([np.zeros(len(dense)), s.start]), np.concatenate([np.ones(len(dense)), s.width])
    values = np.concatenate([panels.values[..., dense], s.values], axis=-1)
    return Splits(index[order], begin[order], width[order], values[..., order])


def placed(parts: Splits, like: Panels | None = None) -> Panels:
    """Return panels in time order as what a signal keeps; `like` has the same and lends its places.

    >>> line = Splits(np.array([0, 0, 1]), np.array([0.0, 0.5, 0.0]), np.array([0.5, 0.5, 1.0]), np.ones((4, 3)))
    >>> placed(line).splits.interval
    array([0, 0])
    """
    sub = (parts.width < 1) | (parts.start > 0)
    values = np.zeros((*parts.values.shape[:-1], int(parts.interval[-1]) + 1 if len(parts.interval) else 0))
    values[..., parts.interval[~sub]] = parts.values[..., ~sub]
    inner = parts.values[..., sub]
    if like is not None:
        return Panels(values, like.splits._replace(values=inner) if sub.any() else like.splits)
    splits = Splits(parts.interval[sub], parts.start[sub], parts.width[sub], inner) if sub.any() else NO_SPLITS
    return Panels(values, splits)


def cut_at(parts: Splits, owner: Ints, tau: Floats) -> Cut:
    """Cut panels, values (q, m), each `owner` at its own coordinate tau in [0, 1]."""
    m, nodes = len(parts.interval), rule(len(parts.values)).nodes
    panel, begin = np.concatenate([np.arange(m), owner]), np.concatenate([np.zeros(m), tau])
    if not len(owner):
        return Cut(parts, panel, begin)
    order = np.lexsort((begin, panel))
    panel, begin = panel[order], begin[order]
    end = np.append(np.where(panel[1:] == panel[:-1], begin[1:], 1.0), 1.0)
    wide = end - begin > LEAST
    panel, begin, width = panel[wide], begin[wide], (end - begin)[wide]
    values, inner = parts.values[:, panel], width < 1
    values[:, inner] = at(parts.values[:, panel[inner]], begin[inner] + width[inner] * nodes[:, None])
    start = parts.start[panel] + begin * parts.width[panel]
    return Cut(Splits(parts.interval[panel], start, width * parts.width[panel], values), panel, begin)


def turned(panels: Panels) -> Splits:
    """Return all panels in time order, cut where the signal turns round: it is monotone on each.

    >>> bowl = (rule(4).nodes[:, None] - 0.3) ** 2
    >>> turned(Panels(bowl)).start.round(9)
    array([0. , 0.3])
    """
    parts, q = every(panels), panels.values.shape[-2]
    places = np.concatenate([[0.0], rule(q).nodes, [1.0]])
    rate = _derivatives(places, q) @ parts.values
    rounding = 1e-12 * np.abs(parts.values).max(axis=0, initial=0.0)
    both = np.flatnonzero((rate > rounding).any(axis=0) & (rate < -rounding).any(axis=0))
    slope = np.asarray(2 * legendre.legder(rule(q).to_legendre @ parts.values[:, both], axis=0), np.float64)
    _, owner, tau = turning(slope, np.linspace(0.0, 1.0, 3 * q + 1))
    return cut_at(parts, both[owner], tau).parts


def _derivatives(places: Floats, q: int) -> Floats:
    """Return the matrix (k, q) from node values to d/dτ at some places."""
    return np.asarray(2 * legendre.legvander(2 * places - 1, q - 2) @ legendre.legder(rule(q).to_legendre, axis=0), float)
