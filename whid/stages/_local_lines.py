"""Straight lines fitted in a window around every Chebyshev node: which samples, with which weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.signal import Floats
from whid.stages._chebyshev import Domain, unscaled

ROUNDING = 1e-9  # of a window's width: inputs closer together are one value


class Line(NamedTuple):
    """A window and its line: value at the node = at_node · y[where], slope = slope · y[where]."""

    where: NDArray[np.intp]
    offset: Floats  # t − node
    at_node: Floats
    slope: Floats
    half_width: float


def lines(t: Floats, centres: Floats, half_widths: Sequence[float], min_points: int, domain: Domain) -> list[Line]:
    """Return the window and the weights of the line at every node; a half-width doubles until it holds min_points samples.

    t (N,), centres and half_widths in units of half the domain. Raises `WhidError`: "stage-too-short" where the samples do
    not suffice, "stage-one-sided" where all lie on one side of the node, "stage-rank-one" where all are at one input.
    """
    found = []
    for i, (centre, half) in enumerate(zip(centres, half_widths, strict=True)):
        offset = t - centre
        away = np.abs(offset)
        while np.count_nonzero(away <= half) < min_points:
            half *= 2
            if half > 2:
                message = f"{len(t)} samples in the domain are too few for windows of {min_points}"
                raise WhidError("stage-too-short", message)
        where = np.flatnonzero(away <= half)
        found.append(_line(where, offset[where], float(half), _Place(i, float(centre), domain, t)))
    return found


class _Place(NamedTuple):
    node: int
    centre: float
    domain: Domain
    t: Floats

    def __str__(self) -> str:
        return f"node {self.node} at input {self._x(self.centre):.4g}"

    def _x(self, t: float) -> float:
        return float(unscaled(np.array(t), self.domain))

    @property
    def covered(self) -> str:
        low, high = self._x(max(-1.0, float(self.t.min()))), self._x(min(1.0, float(self.t.max())))
        return f"of the domain the data cover [{low:.4g}, {high:.4g}]: try that domain"

    def inputs(self, offset: Floats) -> str:
        low, high = (self._x(self.centre + float(edge)) for edge in (offset.min(), offset.max()))
        return f"{low:.4g}" if high - low < 1e-6 * abs(high) else f"{low:.4g} … {high:.4g}"


def _line(where: NDArray[np.intp], offset: Floats, half: float, place: _Place) -> Line:
    n, first, second = len(offset), float(offset.sum()), float(offset @ offset)
    if offset.max() - offset.min() <= ROUNDING * half:
        message = f"{place}: all {n} samples of its window have one input, {place.inputs(offset)}; a line needs two"
        raise WhidError("stage-rank-one", message)
    if offset.min() > 0 or offset.max() < 0:
        message = f"{place}: all {n} samples of its window lie on one side, at {place.inputs(offset)}; {place.covered}"
        raise WhidError("stage-one-sided", message)
    determinant = n * second - first**2
    return Line(where, offset, (second - first * offset) / determinant, (n * offset - first) / determinant, half)


def overlap(found: Sequence[Line], samples: int) -> Floats:
    """Return A·Aᵀ of the weights at the nodes: covariance of the values for unit noise; windows may share samples."""
    from scipy.sparse import csr_array

    starts = np.cumsum([0, *(len(line.where) for line in found)])
    where, weights = (np.concatenate([getattr(line, name) for line in found]) for name in ("where", "at_node"))
    rows = csr_array((weights, where, starts), shape=(len(found), samples))
    return np.asarray((rows @ rows.T).toarray())
