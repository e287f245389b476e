"""Are these harmonics only noise: one F test where the noise is equal, Fisher's combination where it is not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats

UNEQUAL = 1e-4  # p of Bartlett's test below which every order keeps a noise of its own
ROUNDING = 1e-12  # of the largest harmonic: what arithmetic leaves of noise-free data


class NoiseTest(NamedTuple):
    """F(dof, dof_noise), or χ²(dof) with dof_noise 0, and its p."""

    statistic: float
    dof: int
    dof_noise: int
    p: float


def noise_test(square: Floats, dof: NDArray[np.intp], std: Floats, lines: int) -> NoiseTest:
    """Test whether sums of squares are noise of variance std², each std from its own `lines` complex spectral lines.

    Equal noise: F = Σ square / (Σ dof · mean std²) ~ F(Σ dof, 2·lines·K), exact. Unequal (Bartlett, p < 1e-4): each
    F(dof, 2·lines) has a p of its own, combined as −2 Σ ln p ~ χ²(2K) [Fisher]. square, dof, std (K,); p = 1 without lines.

    >>> found = noise_test(np.array([2.0, 2.0]), np.array([2, 2]), np.ones(2), 18)
    >>> found.statistic, found.dof, found.dof_noise
    (1.0, 4, 72)
    """
    from scipy.special import chdtrc, fdtrc

    used = dof > 0
    if not lines or not used.any():
        return NoiseTest(0.0, 0, 0, 1.0)
    if equal(std**2, lines):
        ratio = float(square[used].sum() / (dof.sum() * np.mean(std**2)))
        free, noise = int(dof.sum()), 2 * lines * len(std)
        return NoiseTest(ratio, free, noise, float(fdtrc(free, noise, ratio)))
    p = fdtrc(dof[used], 2 * lines, square[used] / (dof[used] * std[used] ** 2))
    statistic = float(-2 * np.log(np.maximum(p, 1e-300)).sum())
    return NoiseTest(statistic, 2 * int(used.sum()), 0, float(chdtrc(2 * used.sum(), statistic)))


def equal(variance: Floats, lines: int, significance: float = UNEQUAL) -> bool:
    """Tell whether variances of 2·lines degrees of freedom each are one (Bartlett)."""
    from scipy.special import chdtrc

    count, nu = len(variance), 2 * lines
    if count < 2 or not variance.min() > 0:
        return count < 2
    spread = nu * (count * np.log(variance.mean()) - np.log(variance).sum())
    return bool(chdtrc(count - 1, spread / (1 + (count + 1) / (3 * count * nu))) > significance)
