"""The test that the harmonics a polynomial cannot make are only noise."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages.periods import Harmonics


class HarmonicFloor(NamedTuple):
    """Harmonic floor: the test that harmonics above the degree are noise, so that v stayed inside one piece."""

    statistic: float  # −2 Σ ln p over the orders
    dof: int
    p: float
    orders: Annotated[NDArray[np.intp], Quantity("1", ("orders",))]
    order_p: Annotated[Floats, Quantity("1", ("orders",))]  # of each order alone
    worst: int  # the order that stands out most
    passed: bool

    def table(self) -> Table:
        """Return one row and the verdict."""
        if not self.dof:
            return Table("Harmonic floor", ("orders", "χ²", "dof", "p", "worst"), (), ("no order to test",))
        row = (f"{self.orders[0]}-{self.orders[-1]}", round(self.statistic, 2), self.dof, float(f"{self.p:.3g}"), self.worst)
        verdict = "only noise: the sine stayed inside one polynomial piece"
        broken = "more than noise: the sine left its polynomial piece, or the degree is higher"
        return Table("Harmonic floor", ("orders", "χ²", "dof", "p", "worst"), (row,), (verdict if self.passed else broken,))


def harmonic_floor(harmonics: Harmonics, degree: int, significance: float = 0.01) -> HarmonicFloor:
    """Test whether the harmonics above `degree` are noise.

    For order k, F = |value|²/(2·std²) ~ F(2, 2ν) with ν the spectral lines behind std, so p = (1 + F/ν)^−ν; the orders,
    each with an error of its own, are combined by Fisher's −2 Σ ln p ~ χ²(2m). Exact for any number of periods ≥ 3 in
    white noise, and in coloured noise whose spectrum is straight from one harmonic to the next. passed: p ≥ significance.
    With a single period, or no order above the degree, nothing is tested: p = 1.
    Source [Brouri2019], Remark 3.2.

    >>> from whid.stages.periods import harmonics
    >>> n = np.arange(2000)
    >>> y = np.cos(0.02 * np.pi * n) + np.random.default_rng(5).normal(size=2000)
    >>> harmonic_floor(harmonics(y, 100), degree=1).passed, harmonic_floor(harmonics(y, 100), degree=0).worst
    (True, 1)
    """
    from scipy.special import chdtrc

    tested = harmonics.order > degree
    if not tested.any() or not harmonics.own_lines:
        return HarmonicFloor(0.0, 0, 1.0, np.empty(0, np.intp), np.empty(0), 0, True)
    lines, orders = harmonics.own_lines, harmonics.order[tested]
    rounding = 1e-12 * max(float(np.abs(harmonics.value).max()), 1e-300)  # noise-free data: what arithmetic leaves
    ratio = np.abs(harmonics.value[tested]) ** 2 / (2 * harmonics.own_std[tested] ** 2 + rounding**2)
    log_p = -lines * np.log1p(ratio / lines)
    statistic = float(-2 * log_p.sum())
    p = float(chdtrc(2 * len(orders), statistic))
    return HarmonicFloor(
        statistic, 2 * len(orders), p, orders, np.exp(log_p), int(orders[np.argmin(log_p)]), p >= significance
    )
