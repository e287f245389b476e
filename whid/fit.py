"""The only least squares in whid: weighted, bounded, with covariance, rank and a reason to stop.

Linear problems are solved at once, nonlinear ones by Levenberg-Marquardt with Nielsen's damping on analytic tangents.
Both return the same `Estimate`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Quantity

Floats = NDArray[np.float64]
RANK = 1e-10  # of the largest singular value, columns of unit length: what is below counts as zero
GRAM = 1e-13  # the same of a matrix of products, whose numbers are squares
DAMPING, NEAR = 1e-3, 1e-7  # of the first step from any start, and from one that another fit to the same data left
SETTLED = 1e-2  # of χ², in units of the noise: a decrement below, a tenth of a standard error at most, is a minimum
IDLE = 4  # steps in a row that gain next to nothing: a cost with edges never meets its own prediction
WhyStop = Literal["converged", "small step", "no decrease", "iteration limit", "interrupted", "linear", "not fitted"]


class Parameter(NamedTuple):
    """One free scalar: its name (for a tree its path in the YAML, `chain.0.num.1`), start value, unit, bounds."""

    name: str
    value: float
    units: str = "1"
    lower: float = -np.inf
    upper: float = np.inf


class Estimate(NamedTuple):
    """What a least-squares fit found.

    covariance is that of the weighted problem: with weights 1/σ it is the Cramér-Rao bound of Gaussian noise at the
    estimate; without weights it is scaled by the residual variance. Directions that the data do not determine are left
    out of it and listed in null_directions; a parameter that has a part in one has an infinite standard error.
    """

    names: tuple[str, ...]
    values: Annotated[Floats, Quantity(dims=("names",), error="std")]
    std: Annotated[Floats, Quantity(dims=("names",))]
    covariance: Annotated[Floats, Quantity(dims=("names", "names"))]
    rank: int
    null_directions: Annotated[Floats, Quantity(dims=("null", "names"))]  # of unit length, in the parameters' own units
    chi2: float
    dof: int
    iterations: int
    why_stop: WhyStop

    @property
    def correlation(self) -> Floats:
        """Return the correlations (p, p), NaN where a number is not determined."""
        size = np.where(np.isfinite(self.std) & (self.std > 0), self.std, np.nan)
        return np.asarray(self.covariance / np.outer(size, size))

    @property
    def reduced_chi2(self) -> float:
        """Return χ²/dof, NaN without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    def value(self, name: str) -> float:
        """Return one value by name."""
        return float(self.values[self.names.index(name)])


def linear_least_squares(design: Floats, data: Floats, weights: Floats | None = None, names: Sequence[str] = ()) -> Estimate:
    """Minimise Σ wᵢ²(data − design·θ)ᵢ².

    design (m, p), data (m,), weights (m,) = 1/σ (None: σ unknown, from the residual). Source: any text on least squares.

    >>> fit = linear_least_squares(np.vander([0.0, 1.0, 2.0], 2), np.array([1.0, 3.0, 5.0]), np.ones(3))
    >>> fit.values.round(12), fit.rank
    (array([2., 1.]), 2)
    """
    w = np.ones(len(data)) if weights is None else weights
    a, b = design * w[:, None], data * w
    values, covariance, rank, null = _solve(a, b)
    chi2 = float(np.sum((b - a @ values) ** 2))
    names = tuple(names) or tuple(str(k) for k in range(design.shape[1]))
    return _estimate(names, values, covariance, rank, null, chi2, len(data), weights is None, 1, "linear")


def normal_equations(gram: Floats, products: Floats, square: float, samples: int, names: Sequence[str] = ()) -> Estimate:
    """Minimise Σ (data − design·θ)² that is seen only in sums: what streams over a record of any length.

    gram (p, p) = designᵀdesign, products (p,) = designᵀdata, square = dataᵀdata; σ unknown, from the residual. Squared
    numbers tell dependent columns apart to 1e-7 only, and what is left of `square` to 1e-16 of it: fit the residual once
    more where that counts.

    >>> a, b = np.vander([0.0, 1.0, 2.0, 4.0], 2), np.array([1.0, 3.0, 5.0, 8.0])
    >>> bool(np.allclose(normal_equations(a.T @ a, a.T @ b, b @ b, 4).std, linear_least_squares(a, b).std))
    True
    """
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0] = 1.0
    power, directions = np.linalg.eigh(gram / np.outer(scale, scale))
    size = np.sqrt(np.where(power > GRAM * power.max(initial=0.0), power, 0.0))
    inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    projected = inverse * (directions.T @ (products / scale))
    values, covariance, rank, null = _solve(size[:, None] * directions.T * scale, projected)
    chi2 = max(0.0, float(square - projected @ projected))
    names = tuple(names) or tuple(str(k) for k in range(len(gram)))
    return _estimate(names, values, covariance, rank, null, chi2, samples, True, 1, "linear")


def least_squares(
    residual: Callable[[Floats], Floats],
    tangent: Callable[[Floats], Floats],
    parameters: Sequence[Parameter],
    weights: Floats | None = None,
    *,
    max_iterations: int = 100,
    tolerance: float = 1e-8,
    damping: float = DAMPING,
    watch: Callable[[int, float, Floats], None] | None = None,
) -> Estimate:
    """Minimise Σ wᵢ² rᵢ(θ)² within bounds, by Levenberg-Marquardt [Nielsen 1999, Damping parameter in Marquardt's method].

    residual(θ) → (m,), tangent(θ) → (m, p) = ∂r/∂θ, weights (m,) = 1/σ (None: σ unknown). Complex data: stack real and
    imaginary parts. damping: of the first step, less where the start is known to be near. `watch(iteration, χ², θ)` is
    called at every accepted step. Ctrl-C ends a fit that is watched with the best so far and "interrupted"; one that nobody
    watches is a step of something larger, which it ends as well. Converged: the next undamped step is shorter than
    `tolerance` standard errors, or would change χ² by less than rounding does; it is taken and the fit ends.

    >>> t = np.arange(5.0)
    >>> fit = least_squares(lambda p: np.exp(-p[0] * t) - np.exp(-0.3 * t), lambda p: (-t * np.exp(-p[0] * t))[:, None],
    ...                     [Parameter("rate", 1.0)], np.full(5, 100.0))
    >>> round(fit.value("rate"), 9), fit.why_stop
    (0.3, 'converged')
    """
    w = 1.0 if weights is None else weights

    def cost(theta: Floats) -> float:
        r = w * residual(theta)
        return float(r @ r)

    def linearise(theta: Floats) -> Triangle:
        return Triangle.of(tangent(theta) * np.asarray(w)[..., None], w * residual(theta))

    found = minimise(
        cost, linearise, parameters, known=weights is not None, max_iterations=max_iterations, tolerance=tolerance,
        damping=damping, watch=watch,
    )  # fmt: skip
    if found.why_stop == "interrupted" and watch is None:
        raise KeyboardInterrupt
    return found


class Triangle(NamedTuple):
    """A linearised problem, p + 1 numbers a parameter instead of m: R of the QR factorisation of [J | r]."""

    r: Floats  # (p, p)
    projected: Floats  # (p,) Qᵀr
    rest: float  # what no step of the parameters can take from χ²
    samples: int

    @property
    def chi2(self) -> float:
        """Return Σ r²."""
        return float(self.projected @ self.projected) + self.rest

    @classmethod
    def of(cls, jacobian: Floats, r: Floats) -> Triangle:
        """Reduce a whole problem at once."""
        return cls.stacked([np.column_stack([jacobian, r])])

    @classmethod
    def stacked(cls, rows: Iterable[Floats]) -> Triangle:
        """Reduce a problem whose rows [J | r] come in chunks: no more than one chunk is ever kept."""
        both, samples = np.empty((0, 0)), 0
        for part in rows:
            samples += len(part)
            reduced = _triangle(part)
            both = _triangle(np.vstack([both, reduced])) if both.size else reduced
        p = max(both.shape[1] - 1, 0)
        if len(both) < p + 1:
            both = np.pad(both, ((0, p + 1 - len(both)), (0, 0)))
        return cls(both[:p, :p], both[:p, p], float(both[p:, p] @ both[p:, p]), samples)

    def columns(self, keep: NDArray[np.bool_]) -> Triangle:
        """Return the problem with some of its parameters held."""
        if keep.all():
            return self
        tail = np.append(np.zeros(int(keep.sum())), np.sqrt(self.rest))
        reduced = Triangle.stacked([np.vstack([np.column_stack([self.r[:, keep], self.projected]), tail])])
        return reduced._replace(samples=self.samples)


def _triangle(rows: Floats) -> Floats:
    """Return R of a QR factorisation, by Cholesky where that is good enough: five times as fast.

    Once where the columns are far from dependent, twice where they are nearer (then as good as QR), by QR where they nearly
    are. Rᵀ Qᵀr = Jᵀr, the slope, is good to rounding in any case.
    """
    size = np.sqrt(np.einsum("ij,ij->j", rows, rows))
    if len(rows) < 5 * rows.shape[1] or not np.all(np.isfinite(size)):
        return np.asarray(np.linalg.qr(rows, mode="r"), float)
    empty = size == 0  # nothing of this number was seen here
    size[empty] = 1.0
    try:
        gram = rows.T @ rows / np.outer(size, size) + np.diag(empty.astype(float))
        first = np.linalg.cholesky(gram).T
        size[empty] = 0.0
        least = np.abs(np.diag(first)).min()
        if least > 1e-3:
            return np.asarray(first * size, float)
        if least < 1e-5:
            return np.asarray(np.linalg.qr(rows, mode="r"), float)
        scaled = rows @ (np.linalg.inv(first) / np.where(empty, 1.0, size)[:, None])
        return np.asarray(np.linalg.cholesky(scaled.T @ scaled + np.diag(empty.astype(float))).T @ first * size, float)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.qr(rows, mode="r"), float)


def minimise(
    cost: Callable[[Floats], float],
    linearise: Callable[[Floats], Triangle],
    parameters: Sequence[Parameter],
    *,
    known: bool = True,
    max_iterations: int = 100,
    tolerance: float = 1e-8,
    damping: float = DAMPING,
    idle_gain: float = 0.0,
    floor: float = 0.0,
    watch: Callable[[int, float, Floats], None] | None = None,
) -> Estimate:
    """Minimise a sum of squares that is seen only reduced: its value and its `Triangle` at θ (see `least_squares`).

    known: the residuals are in units of their standard deviation; else the covariance is scaled by χ²/dof. floor: χ² of
    rounding; there is nothing to gain below.
    Whether a fit is at its minimum is told by its decrement, λ² = what an undamped step would take from χ² over the noise
    variance: no number is further than λ standard errors from the minimum of the local parabola, −log L no more than λ²/2.
    idle_gain: a few steps in a row that each lower χ² by less (in units of the noise) end the fit, as does a step that fails
    where the decrement is less. A fit that ends with small steps has "converged" where its decrement is below 0.01; a cost
    with an edge, whose slope promises what no step delivers, ends with "small step".
    """
    lower, upper = (np.array([getattr(p, side) for p in parameters], float) for side in ("lower", "upper"))

    def active(here: Triangle, theta: Floats) -> tuple[NDArray[np.bool_], _Directions]:
        """Return which numbers may move, those at a bound that the slope presses on held, and the problem of these."""
        slope = here.r.T @ here.projected
        free = ~(((theta <= lower) & (slope > 0)) | ((theta >= upper) & (slope < 0)))
        return free, _Directions.of(here.columns(free))

    def noise(here: Triangle) -> float:
        return 1.0 if known else here.chi2 / max(here.samples - len(parameters), 1)

    def ended(here: Triangle, theta: Floats) -> WhyStop:
        return "converged" if active(here, theta)[1].gain < SETTLED * noise(here) else "small step"

    theta = np.clip(np.array([p.value for p in parameters], float), lower, upper)
    here = linearise(theta)
    free, moving = active(here, theta)
    why: WhyStop = "iteration limit"
    mu, nu, shrink, iteration, idle = damping, 2.0, 1 / 3, 0, 0
    try:
        for iteration in range(1, max_iterations + 1):
            step, variance, gain = np.zeros_like(theta), noise(here), moving.gain
            if gain <= max(tolerance**2 * variance, 1e-13 * here.chi2, floor):
                step[free] = moving.step()
                trial, why = np.clip(theta + step, lower, upper), "converged"
                with np.errstate(all="ignore"):
                    theta = trial if cost(trial) <= here.chi2 * (1 + 1e-12) + floor else theta  # it may leave what can be
                break
            step[free] = moving.step(mu)
            trial = np.clip(theta + step, lower, upper)
            if np.all(np.abs(trial - theta) <= 1e-15 * (np.abs(theta) + 1e-15)):
                why = ended(here, theta)
                break
            with np.errstate(all="ignore"):
                reached = cost(trial)
            left = here.projected + here.r @ (trial - theta)
            predicted = float(here.projected @ here.projected - left @ left)
            if np.isfinite(reached) and reached < here.chi2:
                ratio = (here.chi2 - reached) / predicted if predicted > 0 else 1.0
                mu *= max(shrink, 1 - (2 * ratio - 1) ** 3)
                nu, shrink = 2.0, max(shrink / 3, 1 / 27)  # one good step after another: bolder, as Nielsen is the other way
                idle = idle + 1 if here.chi2 - reached < idle_gain * variance else 0
                theta, here = trial, linearise(trial)
                free, moving = active(here, theta)
                if watch is not None:
                    watch(iteration, here.chi2, theta)
                if idle == IDLE:
                    why = ended(here, theta)
                    break
            else:
                if mu > 1e12:
                    why = "no decrease"
                    break
                if gain < idle_gain * variance:
                    why = "converged"
                    break
                mu *= nu
                nu, shrink = 2 * nu, 1 / 3
    except KeyboardInterrupt:
        why = "interrupted"
    _, covariance, rank, null = _solve(here.r, here.projected)
    names = tuple(p.name for p in parameters)
    return _estimate(names, theta, covariance, rank, null, here.chi2, here.samples, not known, iteration, why)


class _Directions(NamedTuple):
    """A linearised problem along the directions of its scaled columns: one decomposition, whatever the damping."""

    scale: Floats  # (p,)
    size: Floats  # (p,) singular values
    vt: Floats  # (p, p)
    against: Floats  # (p,) −Uᵀr
    kept: NDArray[np.bool_]  # what the columns reach

    @classmethod
    def of(cls, problem: Triangle) -> _Directions:
        scale = np.sqrt(np.einsum("ij,ij->j", problem.r, problem.r))
        scale[scale == 0] = 1.0
        u, size, vt = np.linalg.svd(problem.r / scale)
        return cls(scale, size, vt, -(problem.projected @ u), size > RANK * size.max(initial=0.0))

    @property
    def gain(self) -> float:
        """Return what an undamped step would still take from χ²: the part of Qᵀr that the columns reach."""
        within = self.against[self.kept]
        return float(within @ within)

    def step(self, mu: float = 0.0) -> Floats:
        """Return the shortest step to the least of χ² + mu·|scaled step|²."""
        along = np.divide(self.size, self.size**2 + mu, out=np.zeros_like(self.size), where=self.kept)
        return np.asarray((along * self.against) @ self.vt / self.scale)


def _solve(a: Floats, b: Floats) -> tuple[Floats, Floats, int, Floats]:
    """Return the minimum-norm solution, its covariance, the rank and the null directions, in scaled columns."""
    scale = np.sqrt(np.einsum("ij,ij->j", a, a))
    scale[scale == 0] = 1.0
    u, s, vt = np.linalg.svd(a / scale, full_matrices=len(a) < a.shape[1])
    rank = int((s > RANK * s.max(initial=0.0)).sum())
    inverse = vt[:rank].T / s[:rank]
    values = inverse @ (u[:, :rank].T @ b) / scale
    covariance = inverse @ inverse.T / np.outer(scale, scale)
    null = vt[rank:] / scale
    null /= np.linalg.norm(null, axis=1, keepdims=True)
    return values, covariance, rank, null


def _estimate(
    names: tuple[str, ...], values: Floats, covariance: Floats, rank: int, null: Floats,
    chi2: float, m: int, unknown: bool, iterations: int, why: WhyStop,
) -> Estimate:  # fmt: skip
    dof = m - rank
    if unknown:
        covariance = covariance * (chi2 / dof) if dof > 0 else np.full_like(covariance, np.nan)
    if unknown and dof <= 0:  # nothing is left over to tell the noise from
        return Estimate(names, values, np.full(len(values), np.inf), covariance, rank, null, chi2, dof, iterations, why)
    undetermined = np.abs(null).max(axis=0, initial=0.0) > 1e-6
    std = np.where(undetermined, np.inf, np.sqrt(np.diag(covariance)))
    return Estimate(names, values, std, covariance, rank, null, chi2, dof, iterations, why)
