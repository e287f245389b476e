"""Global least squares in the Chebyshev basis: the efficient estimate of a memoryless nonlinearity."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.fit import Estimate, normal_equations
from whid.quantity import Quantity
from whid.signal import Floats
from whid.stages._chebyshev import CHUNK, Domain, Moments, basis, moments, nodes, scaled, unscaled


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

    min Σ (y − Σ cₖ Tₖ(t))², t = (2x − a − b)/(b − a), over the samples with |t| ≤ 1. Two passes of moments: the second, of
    the residual, takes off the rounding that squares leave. White noise of unknown size. x, y (N,), finite; extra: terms
    beyond K that `lack_of_fit` tests (left out: K + 1). Raises `WhidError("stage-too-short")` for fewer samples than
    2K + extra, `WhidError("stage-rank-one")` where the input takes too few values, `WhidError("stage-one-sided")` where
    it does not reach the outermost Chebyshev nodes.
    Source: least squares; the Gram matrix from 2K + 1 sums by T_j T_k = (T_{j+k} + T_{|j−k|})/2.

    >>> x = np.random.default_rng(0).uniform(-1, 1, 5000)
    >>> fit = chebyshev_fit(x, 4 * x**3, 4, (-1.0, 1.0))
    >>> bool(np.allclose(fit.coefficients, [0, 3, 0, 1, 0], atol=1e-14))
    True
    """
    wide = order + (order + 1 if extra is None else extra)
    t = scaled(x, domain)
    _reached(t, order, domain)
    inside = np.abs(t) <= 1
    if not inside.all():
        t, y = t[inside], y[inside]
    if len(t) <= wide + order:
        where = f"only {len(t)} samples in the domain [{domain[0]:.4g}, {domain[1]:.4g}] for {order + 1} coefficients"
        raise WhidError("stage-too-short", where)
    first = moments(t, y, wide)
    gram = first.gram(wide)
    inner = gram[: order + 1, : order + 1]
    pilot = normal_equations(inner, first.products[: order + 1], first.square, first.samples)
    if pilot.rank <= order:
        message = f"the input takes too few values for {order + 1} coefficients: their design has rank {pilot.rank}"
        raise WhidError("stage-rank-one", message)
    left = _of_residual(t, y, pilot.values)
    beyond = first.products - gram[:, : order + 1] @ pilot.values
    beyond[: order + 1] = left.products
    found = normal_equations(inner, left.products, left.square, left.samples, _names(order))
    wider = normal_equations(gram, beyond, left.square, left.samples)
    noise = float(np.sqrt(wider.chi2 / wider.dof))
    scale = float(np.sqrt(first.square / first.samples))
    variance = found.chi2 / found.dof
    inverse = np.asarray(found.covariance / variance if variance > 0 else np.linalg.inv(inner), float)
    estimate = found._replace(values=pilot.values + found.values)
    return ChebyshevFit(
        estimate, domain, noise, inverse, found.chi2, wider.chi2, scale, found.rank, wider.rank, len(t), len(x) - len(t)
    )


def _reached(t: Floats, order: int, domain: Domain) -> None:
    """Raise where the samples end before the outermost node: the rest of the domain would be extrapolated."""
    if not len(t):
        return
    end = nodes(order)[0]
    low, high = unscaled(np.array([t.min(), t.max()]), domain)
    if t.max() < end or t.min() > -end:
        seen = f"the samples cover only [{low:.4g}, {high:.4g}]: try that domain"
        raise WhidError("stage-one-sided", f"the domain is [{domain[0]:.4g}, {domain[1]:.4g}], {seen}")


def _of_residual(t: Floats, y: Floats, coefficients: Floats) -> Moments:
    """Return the moments of y − p, chunk by chunk, without sums of T."""
    products, square = np.zeros(len(coefficients)), 0.0
    for start in range(0, len(t), CHUNK):
        part = slice(start, start + CHUNK)
        rows = basis(t[part], len(coefficients) - 1)
        residual = y[part] - coefficients @ rows
        products += rows @ residual
        square += float(residual @ residual)
    return Moments(np.empty(0), products, square, len(t))


def _names(order: int) -> tuple[str, ...]:
    return tuple(f"chain.0.coefficients.{k}" for k in range(order + 1))
