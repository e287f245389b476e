"""Global least squares in the Chebyshev basis: the efficient estimate of a memoryless nonlinearity."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.fit import Estimate, normal_equations
from whid.quantity import Quantity
from whid.signal import Floats
from whid.stages._chebyshev import Domain, nodes, unscaled
from whid.stages._curve_sums import CurveSums, curve_sums, one_chunk
from whid.stages._local_lines import Seen


class ChebyshevFit(NamedTuple):
    """Global least squares: Chebyshev coefficients of all samples in the domain, and of more terms to test against."""

    estimate: Estimate  # of order K; its covariance is the Cramér-Rao bound at the σ it finds
    domain: Annotated[tuple[float, float], Quantity("input")]
    noise_std: Annotated[float, Quantity("output")]  # what K + extra terms leave over
    inverse_gram: Floats  # (K + 1, K + 1)
    rest: Annotated[float, Quantity("output²")]  # Σ (y − p)² with K terms
    wider_rest: Annotated[float, Quantity("output²")]  # with K + extra
    scale: Annotated[float, Quantity("output")]  # rms of y
    rank: int
    wider_rank: int
    samples: int
    outside: int  # samples beyond the domain, not used

    @property
    def coefficients(self) -> Floats:
        """Return C₀ … C_K."""
        return self.estimate.values

    @property
    def bound(self) -> Floats:
        """Return the Cramér-Rao bound of the standard error of every coefficient, at `noise_std`."""
        return np.asarray(self.noise_std * np.sqrt(np.diag(self.inverse_gram)))


def chebyshev_fit(x: Floats, y: Floats, order: int, domain: Domain, extra: int | None = None) -> ChebyshevFit:
    """Return the least-squares Chebyshev coefficients of y over x.

    min Σ (y − Σ cₖ Tₖ(t))², t = (2x − a − b)/(b − a), over the samples with |t| ≤ 1. Moments are those of what a
    pilot leaves over: squares of y itself would round. White noise of unknown size. x, y (N,), finite; extra: terms
    beyond K that `lack_of_fit` tests (left out: K + 1). Raises `WhidError("stage-too-short")` for fewer samples than
    2K + extra, `WhidError("stage-rank-one")` where the input takes too few values, `WhidError("stage-one-sided")` where
    it does not reach the outermost Chebyshev nodes.
    Source: least squares; the Gram matrix from 2K + 1 sums by T_j T_k = (T_{j+k} + T_{|j−k|})/2.

    >>> x = np.random.default_rng(0).uniform(-1, 1, 5000)
    >>> fit = chebyshev_fit(x, 4 * x**3, 4, (-1.0, 1.0))
    >>> bool(np.allclose(fit.coefficients, [0, 3, 0, 1, 0], atol=1e-14))
    True
    """
    return fit_of(curve_sums(one_chunk(x, y), order, domain, extra))


def fit_of(sums: CurveSums) -> ChebyshevFit:
    """Return the fit of samples that were seen in sums: `chebyshev_fit` of any length."""
    order, left, domain = sums.order, sums.left, sums.domain
    wide = len(left.products) - 1
    _reached(sums.seen, order, domain)
    if left.samples <= wide + order:
        where = f"only {left.samples} samples in the domain [{domain[0]:.4g}, {domain[1]:.4g}] for {order + 1} coefficients"
        raise WhidError("stage-too-short", where)
    gram = left.gram(wide)
    inner = gram[: order + 1, : order + 1]
    found = normal_equations(inner, left.products[: order + 1], left.square, left.samples, _names(order))
    if found.rank <= order:
        message = f"the input takes too few values for {order + 1} coefficients: their design has rank {found.rank}"
        raise WhidError("stage-rank-one", message)
    wider = normal_equations(gram, left.products, left.square, left.samples) if wide > order else found
    noise = float(np.sqrt(wider.chi2 / wider.dof))
    scale = float(np.sqrt(sums.square / left.samples))
    variance = found.chi2 / found.dof
    inverse = np.asarray(found.covariance / variance if variance > 0 else np.linalg.inv(inner), float)
    estimate = found._replace(values=sums.pilot + found.values)
    outside = sums.seen.samples - left.samples
    return ChebyshevFit(
        estimate, domain, noise, inverse, found.chi2, wider.chi2, scale, found.rank, wider.rank, left.samples, outside
    )


def _reached(seen: Seen, order: int, domain: Domain) -> None:
    """Raise where the samples end before the outermost node: the rest of the domain would be extrapolated."""
    if not seen.samples:
        return
    end = nodes(order)[0]
    low, high = unscaled(np.array([seen.low, seen.high]), domain)
    if seen.high < end or seen.low > -end:
        said = f"the samples cover only [{low:.4g}, {high:.4g}]: try that domain"
        raise WhidError("stage-one-sided", f"the domain is [{domain[0]:.4g}, {domain[1]:.4g}], {said}")


def _names(order: int) -> tuple[str, ...]:
    return tuple(f"chain.0.coefficients.{k}" for k in range(order + 1))
