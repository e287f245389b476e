"""The test that a periodic input does not move the output: a flat piece of the input nonlinearity."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Quantity, Table
from whid.stages._noise_test import ROUNDING, noise_test
from whid.stages.periods import Harmonics


class ConstantTest(NamedTuple):
    """Constant test: whether any of the first harmonics stands out of the noise."""

    statistic: float  # F(dof, dof_noise); χ²(dof) where the noise differs between orders: dof_noise 0
    dof: int
    dof_noise: int
    p: float
    swing: Annotated[float, Quantity("output")]  # rms of the harmonics, noise not removed
    constant: bool

    def table(self) -> Table:
        """Return one row and the verdict."""
        row = (float(f"{self.statistic:.4g}"), self.dof, self.dof_noise or None, float(f"{self.p:.3g}"))
        verdict = "constant: the input moves along a flat piece" if self.constant else "not constant"
        columns = ("F" if self.dof_noise else "χ²", "dof", "dof of noise", "p")
        return Table("Constant test", columns, (row,), (verdict if self.dof else "one period: nothing to test with",))


def constant_test(harmonics: Harmonics, orders: int = 10, significance: float = 0.01) -> ConstantTest:
    """Test whether harmonics 1 … `orders` of a periodic output are noise, all at once.

    F = (Σ |Y_k|²/2H) / (noise variance of a part) ~ F(2H, 2H·ν), ν = N − 1 spectral lines about each order (N − 2 where N is
    even), N periods: exact in white noise. All H orders, since the first alone vanishes where f′ does. A single period tests
    nothing: p = 1. Source [Brouri2014], section 4.1 ("constant, up to noise").

    >>> from whid.stages.periods import harmonics
    >>> noise = np.random.default_rng(2).normal(size=2100)
    >>> constant_test(harmonics(noise, 100)).constant
    True
    >>> constant_test(harmonics(noise + 0.3 * np.cos(0.04 * np.pi * np.arange(2100)), 100)).constant
    False
    """
    first = slice(1, min(orders, len(harmonics.order) - 1) + 1)
    square = np.abs(harmonics.value[first]) ** 2
    floor = ROUNDING * max(float(np.abs(harmonics.value).max()), 1e-300)
    std = np.hypot(harmonics.own_std[first], floor)
    found = noise_test(square, np.full(len(square), 2), std, harmonics.own_lines)
    return ConstantTest(*found, float(np.sqrt(square.sum() / 2)), found.p >= significance)
