"""Is there no memory? Whether earlier inputs explain what a static curve leaves over."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from whid.fit import normal_equations
from whid.quantity import Table
from whid.signal import Floats
from whid.stages._curve_sums import EVERY, TESTED, CurveSums, curve_sums, one_chunk
from whid.stages.chebyshev_fit import ChebyshevFit
from whid.stages.lack_of_fit import ROUNDING

SIGNIFICANCE = 1e-4  # the order may be too low and the noise uneven: a warning needs more than the odd per cent


class Memory(NamedTuple):
    """Memory: whether the output depends on earlier inputs as well, which no static curve can follow."""

    statistic: float  # F
    lags: int  # that could be told apart
    dof: int
    p: float
    passed: bool
    samples: int  # in the domain
    tested: int  # of them: of a long record the first million, and every 32nd stretch after

    def table(self) -> Table:
        """Return one row and the verdict."""
        row = (self.lags, float(f"{self.statistic:.4g}"), self.dof, float(f"{self.p:.3g}"))
        none = "earlier inputs explain nothing more: no memory seen"
        some = f"asked of {self.tested} of {self.samples} samples: the first {TESTED}, then one stretch in {EVERY}"
        notes = (none if self.passed else self._found, *[some] * (self.tested < self.samples))
        return Table("Memory", ("earlier inputs", "F", "dof", "p"), (row,), notes)

    def doubts(self) -> tuple[str, ...]:
        """Return the warning of a system that remembers."""
        return () if self.passed else (self._found + "; try `identify: {kind: parametric}`",)

    @property
    def _found(self) -> str:
        why = "the system has memory, or its noise is coloured as the input is"
        return f"earlier inputs explain what the curve leaves over (p = {self.p:.2g}): {why}; standard errors are too small"


def memory(x: Floats, y: Floats, earlier: Floats, fit: ChebyshevFit) -> Memory:
    """Test whether x(n − 1), x(n − 2), … join the Chebyshev terms of x(n) in explaining y(n).

    F = ((R − R₊)/L)/(R₊/(N − K − 1 − L)) of two nested linear models; exact for white Gaussian noise and enough order. x, y
    (N,), finite; earlier (L, N). The fit's own samples are used, those in its domain. passed: p ≥ 1e-4, or no more than
    rounding is left.

    >>> from whid.stages.chebyshev_fit import chebyshev_fit
    >>> u = np.random.default_rng(0).uniform(-1, 1, 2001)
    >>> x, last, noise = u[1:], u[:-1], 0.1 * np.random.default_rng(1).normal(size=2000)
    >>> outputs = x**3 + noise, x + 0.1 * last + noise
    >>> [memory(x, y, last[None], chebyshev_fit(x, y, 5, (-1.0, 1.0))).passed for y in outputs]
    [True, False]
    """
    order = len(fit.coefficients) - 1
    return memory_of(curve_sums(one_chunk(x, y, earlier), order, fit.domain, extra=0), fit)


def memory_of(sums: CurveSums, fit: ChebyshevFit) -> Memory:
    """Return the test on samples that were seen in sums."""
    from scipy.special import fdtrc

    order, samples, inside = sums.order, sums.tested.samples, sums.left.samples
    size = order + 1
    own, crossed = sums.tested.gram(order), sums.crossed
    gram = np.block([[own, crossed], [crossed.T, sums.lags]])
    change = fit.coefficients - sums.pilot  # from what the pilot leaves over to what the fit does
    products = np.append(sums.tested.products[:size], sums.lag_products)
    square = max(0.0, sums.tested.square - float(change @ (2 * products[:size] - own @ change)))
    products -= gram[:, :size] @ change
    alone = normal_equations(own, products[:size], square, samples)
    joined = normal_equations(gram, products, square, samples)
    lags, dof = joined.rank - alone.rank, joined.dof
    if lags < 1 or dof < 1 or square <= (ROUNDING * fit.scale) ** 2 * samples:
        return Memory(0.0, max(lags, 0), dof, 1.0, True, inside, samples)
    statistic = float((alone.chi2 - joined.chi2) / lags / max(joined.chi2 / dof, 1e-300))
    p = float(fdtrc(lags, dof, max(statistic, 0.0)))
    return Memory(statistic, lags, dof, p, p >= SIGNIFICANCE, inside, samples)


def lagged(u: Floats, lags: int) -> Iterator[Floats]:
    """Yield u(n − 1), u(n − 2), …, the first value held before the record.

    >>> [row.tolist() for row in lagged(np.array([1.0, 2.0, 3.0]), 2)]
    [[1.0, 1.0, 2.0], [1.0, 1.0, 1.0]]
    """
    for k in range(1, lags + 1):
        yield np.concatenate([np.full(min(k, len(u)), u[0] if len(u) else 0.0), u[: max(len(u) - k, 0)]])
