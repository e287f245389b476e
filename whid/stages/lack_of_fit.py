"""Does the order suffice? The test that decides which estimate of a memoryless curve is reported."""

from __future__ import annotations

from typing import NamedTuple

from whid.quantity import Table
from whid.stages.chebyshev_fit import ChebyshevFit

ROUNDING = 1e-12  # of the output's rms: what arithmetic leaves of noise-free data


class LackOfFit(NamedTuple):
    """Lack of fit: whether Chebyshev terms beyond the order explain more than noise would."""

    statistic: float  # F
    terms: int
    dof: int
    p: float
    passed: bool
    order: int

    def table(self) -> Table:
        """Return one row and the verdict."""
        row = (
            f"{self.order + 1}-{self.order + self.terms}",
            float(f"{self.statistic:.4g}"),
            self.dof,
            float(f"{self.p:.3g}"),
        )
        enough = f"order {self.order} suffices: least squares is reported"
        more = f"order {self.order} does not suffice: node-plus is reported, near the smallest largest error of this order"
        verdict = enough if self.passed else more
        return Table("Lack of fit", ("terms tested", "F", "dof", "p"), (row,), (verdict,))


def lack_of_fit(fit: ChebyshevFit, significance: float = 0.01) -> LackOfFit:
    """Test the terms beyond the order: F = ((R_K − R_W)/(W − K))/(R_W/(N − W − 1)), exact for white Gaussian noise.

    passed: p ≥ significance, or both leave no more than rounding.

    >>> import numpy as np
    >>> from whid.stages.chebyshev_fit import chebyshev_fit
    >>> x = np.linspace(-1, 1, 1000)
    >>> [lack_of_fit(chebyshev_fit(x, y, 5, (-1.0, 1.0))).passed for y in (x**5 - x, np.abs(x))]
    [True, False]
    """
    from scipy.special import fdtrc

    order, terms, dof = fit.rank - 1, fit.wider_rank - fit.rank, fit.samples - fit.wider_rank
    rounding = (ROUNDING * fit.scale) ** 2 * fit.samples
    if not terms or fit.rest <= rounding:
        return LackOfFit(0.0, terms, dof, 1.0, True, order)
    statistic = (fit.rest - fit.wider_rest) / terms / max(fit.wider_rest / dof, rounding / fit.samples)
    p = float(fdtrc(terms, dof, max(statistic, 0.0)))
    return LackOfFit(float(statistic), terms, dof, p, p >= significance, order)
