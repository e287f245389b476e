"""Static curve cut into polynomial pieces: how many, of what degree, and what happens at each border."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.fit import Estimate
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._intervals import intervals
from whid.stages._junctions import Layout, difference, hidden_jump, joint, meet, rescaled
from whid.stages._visits import pooled, visit_variance
from whid.stages.levels import StaticCurve


class Segmentation(NamedTuple):
    """Segmentation: a polynomial on each interval, ascending powers of the input."""

    borders: Annotated[Floats, Quantity("input", ("break", "side"))]  # (S, 2) last level left, first level right
    breaks: Annotated[Floats, Quantity("input", ("break",), error="break_std")]
    break_std: Annotated[Floats, Quantity("input", ("break",))]
    jump: Annotated[NDArray[np.bool_], Quantity("1", ("break",))]  # False: a kink, the pieces meet
    jump_size: Annotated[Floats, Quantity("output", ("break",), error="jump_size_std")]  # right minus left, at the break
    jump_size_std: Annotated[Floats, Quantity("output", ("break",))]
    hidden_jump: Annotated[Floats, Quantity("output", ("break",))]  # the largest that a kink's gap could hide; 0 at a jump
    degrees: Annotated[NDArray[np.intp], Quantity("1", ("piece",))]
    coefficients: Annotated[
        Floats, Quantity("output", ("piece", "power"), error="coefficients_std")
    ]  # NaN beyond the degree
    coefficients_std: Annotated[Floats, Quantity("output", ("piece", "power"))]
    estimate: Estimate  # of every break and coefficient, `breaks.0`, `pieces.0.1`; a kink makes it singular
    chi2: float
    dof: int
    p: float
    visit_std: Annotated[float, Quantity("output")]  # scatter of repeated visits beyond noise, part of every error

    def table(self) -> Table:
        """Return one row a piece, with the break that ends it."""
        rows = []
        for k, degree in enumerate(self.degrees):
            terms = [
                Measured(float(c), float(s)) for c, s in zip(self.coefficients[k], self.coefficients_std[k], strict=True)
            ]
            cells = [*terms[: degree + 1], *[None] * (len(terms) - degree - 1)]
            end = ("", None) if k == len(self.breaks) else (
                "jump" if self.jump[k] else "kink", Measured(float(self.breaks[k]), float(self.break_std[k]))
            )  # fmt: skip
            rows.append((*cells, *end))
        powers = tuple(f"u^{k}" if k > 1 else ("1", "u")[k] for k in range(self.coefficients.shape[1]))
        notes = [f"χ²({self.dof}) = {self.chi2:.3g}, p = {self.p:.2g}"]
        notes += [f"repeated visits scatter by {self.visit_std:.3g} beyond noise"] if self.visit_std else []
        notes += ["a jump's break is only known to lie in its gap"] if self.jump.any() else []
        notes += self.assumed()
        return Table("Pieces of the static curve", (*powers, "ends in", "at, input"), tuple(rows), tuple(notes))

    def assumed(self, kinks: Sequence[int] | None = None) -> list[str]:
        """Return what the levels alone cannot tell about some (default: all) kinks: the errors given take it for granted."""
        chosen = [int(k) for k in np.flatnonzero(~self.jump)] if kinks is None else kinks
        return [
            f"kink at {self.breaks[k]:.4g}: the levels only show that it lies between {self.borders[k, 0]:.6g} and "
            f"{self.borders[k, 1]:.6g}; its error assumes that the pieces meet, where a jump of up to "
            f"{self.hidden_jump[k]:.3g} would fit as well"
            for k in chosen
        ]


def segment(curve: StaticCurve, max_degree: int = 3, price: float = 10.8) -> Segmentation:
    """Cut a static curve into the fewest polynomial pieces that its errors allow.

    Intervals: least Σ over pieces of χ² + price·(degree + 2), by dynamic programming over all intervals of levels; degree ≤
    max_degree and < the number of levels. Border: a kink when making the pieces meet inside the gap costs χ² ≤
    price (the best meeting point is found continuously), else a jump, whose break is only known to lie in its gap (middle,
    std gap/√12). Then one joint fit of all coefficients and kinks. Visits of one level are averaged; where they scatter
    beyond noise that scatter is part of every error. Raises `WhidError("stage-too-short")` below two levels.
    Source [Brouri2019], Remark 3.2.

    >>> from whid.stages.levels import level_means
    >>> u = np.arange(-4.0, 5.0)
    >>> rng = np.random.default_rng(3)
    >>> holds = [np.maximum(v - 0.5, 0) + 0.1 * rng.normal(size=400) for v in u]
    >>> found = segment(level_means(holds, u, np.ones(9), 1.0, 0.0))
    >>> found.degrees, found.jump, found.breaks.round(1)
    (array([0, 1]), array([False]), array([0.5]))
    """
    from scipy.special import chdtrc

    extra = visit_variance(curve)
    level, mean, std, _, _ = pooled(curve, extra=extra)
    if len(level) < 2:
        raise WhidError("stage-too-short", "a static curve needs two levels or more")
    middle, half = (level[0] + level[-1]) / 2, (level[-1] - level[0]) / 2
    z = (level - middle) / half
    cuts, degrees = intervals(z, mean, std, max_degree, price)
    layout = meet(Layout(z, mean, 1 / std, cuts, degrees, np.full(len(cuts), np.nan)), price)
    estimate, layout = joint(layout)
    names, values, covariance = rescaled(layout, estimate, middle, half)
    count = len(layout.cuts)
    full = estimate._replace(
        names=names,
        values=values,
        covariance=covariance,
        std=np.sqrt(np.diag(covariance)),
        null_directions=np.empty((0, len(names))),
    )
    coefficients, errors = _padded(values[count:], degrees), _padded(full.std[count:], degrees)
    size, size_std = _jump_sizes(values[:count], layout.jump, values[count:], covariance[count:, count:], degrees)
    p = float(chdtrc(estimate.dof, estimate.chi2)) if estimate.dof > 0 else 1.0
    hidden = np.array([0.0 if jump else hidden_jump(layout, k) for k, jump in enumerate(layout.jump)])
    return Segmentation(
        np.column_stack([level[layout.cuts - 1], level[layout.cuts]]), values[:count], full.std[:count], layout.jump,
        size, size_std, hidden, degrees, coefficients, errors, full, estimate.chi2, estimate.dof, p, float(np.sqrt(extra)),
    )  # fmt: skip


def _padded(flat: Floats, degrees: Sequence[int] | NDArray[np.intp]) -> Floats:
    rows = np.full((len(degrees), int(max(degrees)) + 1), np.nan)
    for row, part in zip(rows, np.split(flat, np.cumsum(np.asarray(degrees)[:-1] + 1)), strict=True):
        row[: len(part)] = part
    return rows


def _jump_sizes(
    breaks: Floats, jump: NDArray[np.bool_], flat: Floats, covariance: Floats, degrees: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    """Return right − left at every jump, and its error with the break taken as it stands; 0 at a kink."""
    offsets = np.append(0, np.cumsum(degrees + 1))
    size, std = np.zeros(len(breaks)), np.zeros(len(breaks))
    for k in np.flatnonzero(jump):
        left, middle, right = offsets[k : k + 3]
        row = difference(breaks[k : k + 1], middle - left, right - middle)[0]
        size[k] = row @ flat[left:right]
        std[k] = np.sqrt(max(row @ covariance[left:right, left:right] @ row, 0.0))
    return size, std
