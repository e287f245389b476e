"""The ways up and down compared: do they give the same static curve."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._visits import levels_of, pooled
from whid.stages.levels import StaticCurve


class BranchGap(NamedTuple):
    """Branch gap: output on the way up minus output on the way down, at the levels visited both ways."""

    level: Annotated[Floats, Quantity("input", ("level",))]
    gap: Annotated[Floats, Quantity("output", ("level",), error="gap_std")]
    gap_std: Annotated[Floats, Quantity("output", ("level",))]
    significant: Annotated[NDArray[np.bool_], Quantity("1", ("level",))]  # at the family-wise level
    chi2: float
    dof: int
    p: float  # of χ²: no gap anywhere
    largest: Annotated[float, Quantity("output")]  # largest |gap|
    share: float  # largest |gap| / span of the static curve
    memory: bool

    def table(self) -> Table:
        """Return the gap at each level and the verdict."""
        rows = tuple(
            (float(f"{u:.6g}"), Measured(float(g), float(s)), "*" if hit else "")
            for u, g, s, hit in zip(self.level, self.gap, self.gap_std, self.significant, strict=True)
        )
        columns = ("level, input", "gap, output", "")
        if not self.dof:
            return Table("Up minus down", columns, (), ("no level was reached both ways: memory cannot be seen",))
        test = f"χ²({self.dof}) = {self.chi2:.3g}, p = {self.p:.2g}"
        figures = f"largest gap {self.largest:.3g}, {100 * self.share:.3g} % of the span; {test}"
        small = "; no more than slow drift or settling explain" if self.significant.any() else ""
        marked = ("* differs beyond noise",) if self.significant.any() else ()
        verdict = "memory, or a drift" if self.memory else f"no memory claimed{small}"
        return Table("Up minus down", columns, rows, (*marked, figures, verdict))

    def doubts(self) -> tuple[str, ...]:
        """Return what a model without memory leaves out."""
        if not self.memory:
            return ()
        found = f"up and down branches differ by {self.largest:.3g} ({100 * self.share:.3g} % of the span)"
        return (f"{found}: memory (relay, backlash) or a drift, which a static f does not have; a second staircase tells",)


def branch_gap(curve: StaticCurve, significance: float = 0.01, settled_within: float = 0.02) -> BranchGap:
    """Compare the branches of a static curve; memory is claimed where they differ beyond noise and beyond settling.

    χ² = Σ gap²/(σ↑² + σ↓²) over the levels visited both ways, repeated visits averaged. Memory: p < significance and
    the largest gap exceeds `settled_within` of the curve's span, since a hold that is only settled to that band, or a rig
    that warms up, opens the same gap. Levels are marked at the family-wise level (Šidák). Where visits of one
    level on one branch scatter beyond noise (p < 0.01), the errors grow with it.

    >>> import numpy as np
    >>> from whid.stages.levels import level_means
    >>> rng = np.random.default_rng(0)
    >>> level, way = np.array([0.0, 1, 2, 1, 0]), np.array([1.0, 1, 1, -1, -1])
    >>> curve = level_means([u + 0.1 * rng.normal(size=99) for u in level - 0.2 * (way < 0)], level, way, 1.0, 0.0)
    >>> branch_gap(curve).gap.round(1), branch_gap(curve).memory
    (array([0.2, 0.2]), True)
    """
    from scipy.special import chdtrc, erfc

    number = levels_of(curve)
    up, down = curve.direction > 0, curve.direction < 0
    both = np.intersect1d(number[up], number[down])
    span = float(np.ptp(curve.mean))
    if not len(both):
        none = np.empty(0)
        return BranchGap(none, none, none, np.empty(0, bool), 0.0, 0, 1.0, 0.0, 0.0, False)
    high, low = (pooled(curve, side & np.isin(number, both)) for side in (up, down))
    repeats, spare = high.chi2 + low.chi2, high.dof + low.dof
    inflation = repeats / spare if spare and chdtrc(spare, repeats) < 0.01 else 1.0
    gap, std = high.mean - low.mean, np.hypot(high.std, low.std) * np.sqrt(inflation)
    chi2 = float(np.sum((gap / std) ** 2))
    p = float(chdtrc(len(gap), chi2))
    alone = erfc(np.abs(gap / std) / np.sqrt(2))
    largest = float(np.abs(gap).max())
    share = largest / span if span else 0.0
    marked = alone < 1 - (1 - significance) ** (1 / len(gap))
    return BranchGap(
        high.level, gap, std, marked, chi2, len(gap), p, largest, share, p < significance and share > settled_within
    )
