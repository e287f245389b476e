"""Maximum likelihood for any tree on any records: least squares on the simulation error, all free numbers at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from whid.fit import Parameter, minimise
from whid.record import Record
from whid.refine._free import FreeNumbers
from whid.refine._gauge import gauged
from whid.refine._noise import Noise, with_noise
from whid.refine._periodic import periodic as averaged
from whid.refine._problem import Problem, data_of
from whid.refine._result import Refined, result_of
from whid.signal import Floats
from whid.system import System

Watch = Callable[[int, float], None]  # iteration, χ² per sample in units of the noise assumed
ROUNDS = 8  # of noise model and fit
CLOSE = 1e-3  # standard errors: the fit is finished
NEAR = 0.1  # the same where derivatives are those of a near model, which know no better
IDLE_GAIN = 1e-2  # of χ²: steps that gain less, a tenth of a standard error at most, or cannot be made to, end it as well


def refine(
    system: System,
    records: Sequence[Record],
    *,
    path: str = "exact",
    rates: str = "",
    noise: Noise = "white",
    robust: bool = False,
    fixed: Sequence[str] = (),
    tied: Sequence[Sequence[str]] = (),
    std: Sequence[float] | None = None,
    ar: Sequence[Sequence[float]] | None = None,
    periodic: bool = False,
    watch: Watch | None = None,
    max_iterations: int = 60,
) -> Refined:
    """Fit all free numbers of a system to the estimation samples of all records at once.

    min Σ_records Σ_samples (y − ŷ(θ))²/σ², ŷ simulated from the record's initial state. `fix:` in the tree holds numbers; so
    does `fixed`, names or their beginnings (`chain.0`). `tied` are groups of names with one common value. Pieces that meet
    at a break (a kink) keep meeting. Directions without effect are held and said in words. Every record has a noise of its
    own: σ from its residual (or `std`, known, and its colour `ar`), coloured with `noise="ar"`: residual and tangents are
    prewhitened.
    `robust`: Huber's loss. `periodic`: the settled periods of periodic parts are averaged first (white noise only; their
    lead periods are left out): the same answer, far cheaper. `initial: free`: the levels of an unknown past are nuisance
    numbers.
    `rates`: the path of the derivatives, where it is another one: those of a loop in continuous time cost a twentieth on
    samples; the fit then ends as near the minimum, in standard errors, as they are.
    `watch(iteration, χ²/N)` follows; Ctrl-C keeps the best so far, `estimate.why_stop` says so.
    Raises `WhidError("fit-no-data")`, `"fit-parameter"`, `"fit-start"`. Source [PAPERS A, build 6].

    >>> from dataclasses import replace
    >>> from whid.blocks.linear import Linear
    >>> u = np.repeat([1.0, -1.0, 2.0, 0.0], 20)
    >>> lag = Linear(num=(1.0,), den=(3.0, 1.0))
    >>> found = refine(System(chain=(replace(lag, den=(2.0, 1.0)),)), [Record(u=u, y=lag(u, 0.5), dt=0.5)])
    >>> found.estimate.names, found.estimate.values.round(6), found.gauge[0]
    (('chain.0.num.0', 'chain.0.den.0'), array([1., 3.]),
     'num and den of chain.0 (linear) may be scaled together, only their ratio counts: chain.0.den.1 is held')
    """
    data = data_of(records, system.tree, std)
    if ar is not None:
        colours = {record.name: np.asarray(a, float) for record, a in zip(records, ar, strict=True)}
        data = tuple(replace(d, ar=colours[d.record.name]) for d in data)
    if periodic and noise == "white" and not robust:
        data = tuple(part for d in data for part in averaged(d, system.tree))
    problem, gauge = gauged(FreeNumbers(system.tree, tuple(fixed), tuple(map(tuple, tied))), data, path, rates)
    theta = problem.start
    close = CLOSE if rates in ("", path) else NEAR
    several = len({d.record.name for d in data}) > 1
    learn = std is None and (several or noise == "ar" or robust)
    if std is None and several:
        problem = with_noise(problem, theta, "white", robust=False)
    for turn in range(ROUNDS):
        samples = sum(d.samples for d in data)
        fit = minimise(
            problem.cost, problem.linearise, _started(problem, theta), known=std is not None,
            max_iterations=max_iterations, tolerance=close, idle_gain=IDLE_GAIN,
            floor=problem.rounding, watch=_told(watch, samples),
        )  # fmt: skip
        moved = np.abs(fit.values - theta) / np.where(np.isfinite(fit.std) & (fit.std > 0), fit.std, np.inf)
        theta = fit.values
        settled = turn > 0 and float(moved.max(initial=0.0)) < 0.01
        if not learn or settled or fit.why_stop == "interrupted":
            break
        problem = with_noise(problem, theta, noise, robust=robust)
        if len(data) == 1 and not robust and not len(problem.data[0].ar):
            break  # the noise is white after all
    return result_of(system, problem, fit, gauge, known=std is not None)


def _told(watch: Watch | None, samples: int) -> Callable[[int, float, Floats], None] | None:
    return None if watch is None else lambda iteration, chi2, theta: watch(iteration, chi2 / samples)


def _started(problem: Problem, theta: Floats) -> list[Parameter]:
    return [p._replace(value=float(v)) for p, v in zip(problem.parameters, theta, strict=True)]
