"""Maximum likelihood for any tree on any records: least squares on the simulation error, all free numbers at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid._refine_free import FreeNumbers
from whid._refine_periodic import periodic as averaged
from whid._refine_problem import Data, Problem, data_of
from whid._refine_words import common_factor, dependent, in_words, last_to_hold
from whid.blocks._block import STEADY, Block
from whid.errors import WhidError
from whid.fit import Estimate, Parameter, Triangle, minimise
from whid.predict import chunks, input_signal
from whid.quantity import Quantity, Table
from whid.record import Record
from whid.signal import Floats, rms
from whid.stages._whiten import autoregression, whitened
from whid.system import System

Noise = Literal["white", "ar"]
Watch = Callable[[int, float], None]  # iteration, χ² per sample in units of the noise assumed
HUBER = 1.345  # of σ: 95 % efficient where the noise is Gaussian
ROUNDS = 8  # of noise model and fit
CLOSE = 1e-3  # standard errors: the fit is finished


class Refined(NamedTuple):
    """A fitted system, what its numbers are worth, and what was left over.

    estimate names every number that moved by its path in the tree, those that follow from others (ties, kinks) included.
    gauge    says in words what the data cannot tell, and what was held for it
    """

    system: System
    estimate: Estimate
    record: tuple[str, ...]
    samples: Annotated[Floats, Quantity("1", ("record",))]
    rms: Annotated[Floats, Quantity("output", ("record",))]
    noise_std: Annotated[Floats, Quantity("output", ("record",))]  # of the innovation, where the noise is coloured
    ar: Annotated[Floats, Quantity("1", ("record", "lag"))]  # e(t) = Σ aₖ e(t − k) + innovation, NaN beyond the order
    parameters: int  # numbers fitted, those that follow from others not counted
    gauge: tuple[str, ...]

    def table(self) -> Table:
        """Return one row a record."""
        rows = zip(self.record, self.samples, self.rms, self.noise_std, self.ar, strict=True)
        cells = tuple((name, int(n), float(e), float(s), int(np.isfinite(a).sum())) for name, n, e, s, a in rows)
        e = self.estimate
        note = f"{self.parameters} numbers, {e.iterations} iterations, {e.why_stop}; BIC {self.bic:.1f}"
        return Table("Fit", ("record", "samples", "residual rms", "noise std", "noise order"), cells, (note, *self.gauge))

    @property
    def bic(self) -> float:
        """Return −2 log L + p log N."""
        noise = int(np.isfinite(self.ar).sum())
        likelihood = (
            float(self.samples @ (np.log(2 * np.pi) + 2 * np.log(np.maximum(self.noise_std, 1e-300)))) + self.samples.sum()
        )
        return float(likelihood + (self.parameters + noise) * np.log(self.samples.sum()))


def refine(
    system: System,
    records: Sequence[Record],
    *,
    path: str = "exact",
    noise: Noise = "white",
    robust: bool = False,
    fixed: Sequence[str] = (),
    tied: Sequence[Sequence[str]] = (),
    std: Sequence[float] | None = None,
    periodic: bool = False,
    watch: Watch | None = None,
    max_iterations: int = 60,
) -> Refined:
    """Fit all free numbers of a system to the estimation samples of all records at once.

    min Σ_records Σ_samples (y − ŷ(θ))²/σ², ŷ simulated from the record's initial state. `fix:` in the tree holds numbers; so
    does `fixed`, names or their beginnings (`chain.0`). `tied` are groups of names with one common value. Pieces that meet
    at a break (a kink) keep meeting. Directions without effect are held and said in words. Every record has a noise of its
    own: σ from its residual (or `std`, known), coloured with `noise="ar"`: residual and tangents are prewhitened.
    `robust`: Huber's loss. `periodic`: the settled periods of periodic parts are averaged first (white noise only; their
    lead periods are left out): the same answer, far cheaper. `initial: free`: the levels of an unknown past are nuisance
    numbers.
    `watch(iteration, χ²/N)` follows; Ctrl-C keeps the best so far, `estimate.why_stop` says so.
    Raises `WhidError("fit-no-data")`, `WhidError("fit-parameter")`. Source [PAPERS A, build 6].

    >>> from whid.blocks.linear import Linear
    >>> u = np.repeat([1.0, -1.0, 2.0, 0.0], 20)
    >>> lag = Linear(num=(1.0,), den=(3.0, 1.0))
    >>> found = refine(System(chain=(replace(lag, den=(2.0, 1.0)),)), [Record(u=u, y=lag(u, 0.5), dt=0.5)])
    >>> found.estimate.names, found.estimate.values.round(6), found.gauge[0]
    (('chain.0.num.0', 'chain.0.den.0'), array([1., 3.]),
     'numerator and denominator of chain.0 (linear) have a common factor: chain.0.den.1 is held')
    """
    data = data_of(records, system.tree, std)
    if periodic and noise == "white" and not robust:
        data = tuple(part for d in data for part in averaged(d, system.tree))
    problem, gauge = _gauged(FreeNumbers(system.tree, tuple(fixed), tuple(map(tuple, tied))), data, path)
    theta = problem.start
    several = len({d.record.name for d in data}) > 1
    learn = std is None and (several or noise == "ar" or robust)
    if std is None and several:
        problem = _with_noise(problem, theta, "white", robust=False)
    for turn in range(ROUNDS):
        samples = sum(d.samples for d in data)
        fit = minimise(
            problem.cost, problem.linearise, _started(problem, theta), known=std is not None,
            max_iterations=max_iterations, tolerance=CLOSE, idle_gain=CLOSE, watch=_told(watch, samples),
        )  # fmt: skip
        moved = np.abs(fit.values - theta) / np.where(np.isfinite(fit.std) & (fit.std > 0), fit.std, np.inf)
        theta = fit.values
        settled = turn > 0 and float(moved.max(initial=0.0)) < 0.01
        if not learn or settled or fit.why_stop == "interrupted":
            break
        problem = _with_noise(problem, theta, noise, robust=robust)
        if len(data) == 1 and not robust and not len(problem.data[0].ar):
            break  # the noise is white after all
    return _result(system, problem, fit, gauge, known=std is not None)


def bound(
    system: System, records: Sequence[Record], std: Sequence[float], *, path: str = "exact", fixed: Sequence[str] = (),
    tied: Sequence[Sequence[str]] = (), ar: Floats | None = None,
) -> Estimate:  # fmt: skip
    """Return the Cramér-Rao bound of a plan: the least standard errors that records with this input and noise allow.

    covariance = (JᵀJ)⁻¹ at the system's own numbers, J the whitened tangents over std (one a record); y is not looked at.

    >>> from whid.blocks.polynomial import Polynomial
    >>> line = System(chain=(Polynomial(coefficients=(0.0, 1.0), fix=("coefficients.0",)),))
    >>> plan = Record(u=np.array([3.0, 4.0]), y=np.full(2, np.nan), dt=1.0)
    >>> float(bound(line, [plan], [10.0], fixed=["chain.0.coefficients.0"]).std[0])
    2.0
    """
    data = data_of([replace(record, y=np.zeros(len(record))) for record in records], system.tree, std)
    if ar is not None:
        data = tuple(replace(d, ar=np.asarray(ar, float)) for d in data)
    problem, _ = _gauged(FreeNumbers(system.tree, tuple(fixed), tuple(map(tuple, tied))), data, path)
    theta = problem.start
    fit = minimise(problem.cost, problem.linearise, problem.parameters, max_iterations=0)
    return _expanded(problem, fit._replace(values=theta, chi2=0.0))


def band(tree: Block, record: Record, estimate: Estimate, path: str = "exact") -> Floats:
    """Return the standard error of every sample of ŷ that the numbers' own errors make: sqrt(diag(J Σ Jᵀ)), (N,).

    Numbers that the estimate names but the tree does not have are left out, as are those without a finite error.
    """
    known = {p.name for p in tree.parameters(held=True)}
    keep = [k for k, name in enumerate(estimate.names) if name in known and np.isfinite(estimate.std[k])]
    covariance = estimate.covariance[np.ix_(keep, keep)]
    u = input_signal(tree, record, path)
    state = None if record.initial == "rest" else STEADY
    out = np.empty(len(record))
    for part in chunks(len(record)):
        _, tangents, state = tree.tangent(u[part], [], [estimate.names[k] for k in keep], state)
        j = np.array([t.values for t in tangents]).reshape(len(keep), -1)
        out[part] = np.sqrt(np.maximum(np.einsum("in,ij,jn->n", j, covariance, j), 0.0))
    return out


def profile(system: System, records: Sequence[Record], name: str, values: Floats, *, path: str = "exact") -> Floats:
    """Return Σ (y − ŷ)² with one number at each of some values and all others held; infinite where nothing simulates.

    >>> from whid.blocks.polynomial import Polynomial
    >>> line = System(chain=(Polynomial(coefficients=(0.0, 1.0)),))
    >>> profile(line, [Record(u=np.ones(4), y=np.full(4, 3.0), dt=1.0)], "chain.0.coefficients.1", np.array([1.0, 3.0]))
    array([16.,  0.])
    """
    data = data_of(records, system.tree)

    def cost(value: float) -> float:
        try:
            tree = system.tree.with_parameters({name: value})
        except WhidError:
            return float("inf")
        problem = Problem(FreeNumbers(tree, tuple(p.name for p in tree.parameters(held=True))), data, path)
        return problem.cost(problem.start)

    return np.array([cost(float(value)) for value in values])


def gains(system: System, records: Sequence[Record], extra: Sequence[str], *, path: str = "exact", fixed: Sequence[str] = (),
) -> Floats:  # fmt: skip
    """Return by how much each extra number alone, freed beside the others, would lower χ² (its score test, one degree).

    The system stands at its fit without the extra numbers. (Σ over the records, in units of the residual's variance.)
    """
    data = data_of(records, system.tree)
    problem = Problem(FreeNumbers(system.tree, tuple(fixed)), data, path)
    problem = _with_noise(problem, problem.start, "white", robust=False)
    names = [p.name for p in problem.parameters]
    whole = problem.linearise(problem.start)
    base = np.array([name not in extra for name in names])

    def left(keep: NDArray[np.bool_]) -> float:
        return whole.columns(keep).rest

    return np.array([left(base) - left(base | (np.array(names) == name)) for name in extra])


class Starts(NamedTuple):
    """Several fits from several starts: the best, and where the others ended."""

    best: Refined
    cost: Annotated[Floats, Quantity("1", ("start",))]  # Σ samples·log σ² of each, the best 0
    agreeing: int  # starts that ended as low as the best, to 1 in χ²

    def table(self) -> Table:
        """Return where every start ended."""
        rows = tuple((k + 1, float(c)) for k, c in enumerate(self.cost))
        return Table("Starts", ("start", "−2 log L above the best"), rows, (f"{self.agreeing} of {len(rows)} agree",))


def multistart(
    system: System, records: Sequence[Record], starts: int, rng: np.random.Generator, spread: float = 0.3,
    **options: object,
) -> Starts:  # fmt: skip
    """Fit from the given numbers and from `starts` − 1 scattered ones (each times exp(spread·normal)), keep the best.

    A start that cannot be simulated counts as one that ended nowhere (infinite cost).
    """
    first = refine(system, records, **options)  # type: ignore[arg-type]
    found: list[Refined | None] = [first]
    free = [p for p in system.tree.parameters() if p.name in first.estimate.names]  # what holds a gauge stays
    for _ in range(starts - 1):
        moved = {p.name: float(np.clip(p.value * np.exp(spread * rng.standard_normal()), p.lower, p.upper)) for p in free}
        try:
            tree = system.tree.with_parameters(moved)
            found.append(refine(replace(system, chain=tree.chain), records, **options))  # type: ignore[arg-type]
        except (WhidError, ValueError, np.linalg.LinAlgError):
            found.append(None)
    cost = np.array([np.inf if f is None else float(f.samples @ np.log(np.maximum(f.noise_std, 1e-300)) * 2) for f in found])
    best = found[int(np.nanargmin(cost))]
    assert best is not None
    cost -= np.nanmin(cost)
    return Starts(best, cost, int(np.sum(cost < 1.0)))


def _told(watch: Watch | None, samples: int) -> Callable[[int, float, Floats], None] | None:
    return None if watch is None else lambda iteration, chi2, theta: watch(iteration, chi2 / samples)


def _started(problem: Problem, theta: Floats) -> list[Parameter]:
    return [p._replace(value=float(v)) for p, v in zip(problem.parameters, theta, strict=True)]


def _gauged(free: FreeNumbers, data: tuple[Data, ...], path: str) -> tuple[Problem, tuple[str, ...]]:
    """Return the problem without directions that have no effect, and what was held for them."""
    problem = Problem(free, data, path)
    names = [p.name for p in problem.parameters]
    triangle = problem.linearise(problem.start)
    found = [(names[j], d) for j, d in dependent(triangle, last_to_hold(free.tree, names)) if names[j] in set(free.names)]
    if not found:
        return problem, ()
    words = tuple(f"{_said(free.tree, names, triangle, name, direction)}: {name} is held" for name, direction in found)
    held = (*free.held, *(name for name, _ in found))
    return Problem(replace(free, held=held), data, path), words


def _said(tree: Block, names: list[str], triangle: Triangle, name: str, direction: Floats) -> str:
    """Return a direction in words: the common factor of one linear block where that is what it is."""
    own = common_factor(tree, names, name) if ".den." in name else None
    if own is not None:
        size = np.linalg.norm(triangle.r, axis=0) @ np.abs(own)
        direction = own if np.linalg.norm(triangle.r @ own) < 1e-6 * size else direction
    return in_words(tree, names, direction)


def _with_noise(problem: Problem, theta: Floats, noise: Noise, *, robust: bool) -> Problem:
    """Return the problem with each record's noise as its residual shows it."""
    data = []
    errors = problem.residuals(theta)
    if noise == "white" and not robust:
        std = _by_record(
            problem, [d.periods * np.nansum(e**2) + d.scatter for d, e in zip(problem.data, errors, strict=True)]
        )
        return replace(problem, data=tuple(replace(d, std=max(std[d.record.name], 1e-300)) for d in problem.data))
    for d, e in zip(problem.data, errors, strict=True):
        ar = autoregression(e, d.use) if noise == "ar" else np.empty(0)
        white = whitened(np.where(d.use, e, 0.0)[:, None], d.use, ar)[:, 0]
        size = float(np.median(np.abs(white[d.use])) / 0.6745) if robust else rms(white[d.use])
        weight = np.sqrt(np.minimum(1.0, HUBER * size / np.maximum(np.abs(white), 1e-300))) if robust else None
        data.append(replace(d, ar=ar, std=max(size, 1e-300), weight=weight))
    return replace(problem, data=tuple(data))


def _by_record(problem: Problem, squares: Sequence[float]) -> dict[str, float]:
    """Return the root mean square of every record, whose averaged parts stand apart in the problem."""
    total, samples = dict.fromkeys((d.record.name for d in problem.data), 0.0), _samples(problem)
    for d, each in zip(problem.data, squares, strict=True):
        total[d.record.name] += float(each)
    return {name: float(np.sqrt(total[name] / samples[name])) for name in total}


def _samples(problem: Problem) -> dict[str, int]:
    count = dict.fromkeys((d.record.name for d in problem.data), 0)
    for d in problem.data:
        count[d.record.name] += d.samples
    return count


def _expanded(problem: Problem, fit: Estimate) -> Estimate:
    """Return the estimate of every number that moved, the past's levels left out."""
    own = len(problem.free.parameters)
    values, change = problem.free.expanded(fit.values[:own])
    covariance = change @ fit.covariance[:own, :own] @ change.T
    null = fit.null_directions[:, :own] @ change.T
    null = null[np.abs(null).max(axis=1, initial=0.0) > 0]
    lost = (np.abs(change) @ np.isinf(fit.std[:own])) > 0
    std = np.where(lost, np.inf, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    return fit._replace(names=problem.free.names, values=values, std=std, covariance=covariance, null_directions=null)


def _result(system: System, problem: Problem, fit: Estimate, gauge: tuple[str, ...], *, known: bool) -> Refined:
    estimate = _expanded(problem, fit)
    tree = system.tree.with_parameters(dict(zip(estimate.names, estimate.values.tolist(), strict=True)))
    if not known:
        estimate = estimate._replace(chi2=float(max(fit.dof, 0)))
    unseen = [name for name, std in zip(estimate.names, estimate.std, strict=True) if np.isinf(std)]
    if unseen:
        gauge = (*gauge, f"the data do not determine {', '.join(unseen)}")
    errors = problem.residuals(fit.values)
    pairs = list(zip(problem.data, errors, strict=True))
    white = [whitened(np.where(d.use, e, 0.0)[:, None], d.use, d.ar)[d.use, 0] for d, e in pairs]
    size, innovation = (
        _by_record(problem, [d.periods * np.nansum(e**2) + d.scatter for d, e in zip(problem.data, each, strict=True)])
        for each in (errors, white)
    )
    ar = {d.record.name: d.ar for d in problem.data}
    order = max(map(len, ar.values()))
    return Refined(
        replace(system, chain=tree.chain), estimate, tuple(size), np.array([float(n) for n in _samples(problem).values()]),
        np.array(list(size.values())), np.array(list(innovation.values())),
        np.array([np.pad(a, (0, order - len(a)), constant_values=np.nan) for a in ar.values()]),
        fit.rank, gauge,
    )  # fmt: skip
