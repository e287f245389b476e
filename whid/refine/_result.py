"""What a whole-record fit found: the system, what its numbers are worth, what was left over."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.fit import Estimate
from whid.quantity import Quantity, Table
from whid.refine._free import walk
from whid.refine._noise import by_record, samples_of
from whid.refine._problem import Problem
from whid.signal import Floats
from whid.stages._whiten import whitened
from whid.system import System


class Refined(NamedTuple):
    """A fitted system, what its numbers are worth, and what was left over.

    estimate names every number that moved by its path in the tree, those that follow from others (ties, kinks) included.
    gauge    says in words what the data cannot tell, what was held for it, and what stopped at a bound
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
        fit = f"{self.parameters} numbers, {e.iterations} iterations, {e.why_stop}"
        noise = "noise std from the residual" if e.chi2 == e.dof else f"χ²/dof {e.reduced_chi2:.3g}"
        notes = (f"{fit}; {noise}; BIC {self.bic:.1f}", *self._correlated(), *self.gauge)
        return Table("Fitted records", ("record", "samples", "residual rms", "noise std", "noise order"), cells, notes)

    def _correlated(self) -> tuple[str, ...]:
        """Return the two numbers that are hardest to tell apart."""
        size = np.nan_to_num(np.abs(np.tril(self.estimate.correlation, -1)))
        if not size.size or not size.any():
            return ()
        i, j = np.unravel_index(int(size.argmax()), size.shape)
        pair = self.estimate.names[j], self.estimate.names[i]
        return (f"largest correlation {self.estimate.correlation[i, j]:.3f}: {pair[0]} with {pair[1]}",)

    @property
    def bic(self) -> float:
        """Return −2 log L + p log N."""
        noise = int(np.isfinite(self.ar).sum())
        likelihood = (
            float(self.samples @ (np.log(2 * np.pi) + 2 * np.log(np.maximum(self.noise_std, 1e-300)))) + self.samples.sum()
        )
        return float(likelihood + (self.parameters + noise) * np.log(self.samples.sum()))


SWITCHES = ("quantizer", "relay")  # flat between their jumps


def result_of(system: System, problem: Problem, fit: Estimate, gauge: tuple[str, ...], *, known: bool) -> Refined:
    estimate = expanded(problem, fit)
    tree = system.tree.with_parameters(dict(zip(estimate.names, estimate.values.tolist(), strict=True)))
    if not known:
        estimate = estimate._replace(chi2=float(max(fit.dof, 0)))
    gauge = (*gauge, *_undetermined(tree, estimate), *_bounded(problem, fit))
    errors = problem.residuals(fit.values)
    pairs = list(zip(problem.data, errors, strict=True))
    white = [whitened(np.where(d.use, e, 0.0)[:, None], d.use, d.ar)[d.use, 0] for d, e in pairs]
    size, innovation = (
        by_record(problem, [d.periods * np.nansum(e**2) + d.scatter for d, e in zip(problem.data, each, strict=True)])
        for each in (errors, white)
    )
    ar = {d.record.name: d.ar for d in problem.data}
    order = max(map(len, ar.values()))
    return Refined(
        replace(system, chain=tree.chain), estimate, tuple(size), np.array([float(n) for n in samples_of(problem).values()]),
        np.array(list(size.values())), np.array(list(innovation.values())),
        np.array([np.pad(a, (0, order - len(a)), constant_values=np.nan) for a in ar.values()]),
        fit.rank, gauge,
    )  # fmt: skip


def _undetermined(tree: Block, estimate: Estimate) -> tuple[str, ...]:
    """Return in words which numbers the data do not determine, and what hides them where it is a switch."""
    unseen = [name for name, std in zip(estimate.names, estimate.std, strict=True) if np.isinf(std)]
    if not unseen:
        return ()
    if estimate.dof <= 0:
        return (f"{estimate.dof + estimate.rank} samples for {estimate.rank} numbers: nothing is left to tell errors from",)
    said = [f"the data do not determine {', '.join(unseen)}"]
    for path, block in walk(tree):
        if block.kind in SWITCHES and any(_ahead(name, path) for name in unseen):
            said.append(
                f"{path.rstrip('.')} ({block.kind}) hides small changes of what is ahead of it: their derivative is 0"
            )
    return tuple(said)


def _ahead(name: str, path: str) -> bool:
    """Tell whether a number belongs to a block before the one at `path` in the same chain."""
    parent, _, place = path.rstrip(".").rpartition(".")
    rest = name.removeprefix(f"{parent}.").partition(".")[0]
    return name.startswith(f"{parent}.") and rest.isdigit() and place.isdigit() and int(rest) < int(place)


def _bounded(problem: Problem, fit: Estimate) -> list[str]:
    pairs = [(p, v) for p, v in zip(problem.free.parameters, fit.values, strict=False) if not p.lower < v < p.upper]
    return [f"{p.name} stopped at its bound, {float(v):g}: its standard error is that of a free number" for p, v in pairs]


def expanded(problem: Problem, fit: Estimate) -> Estimate:
    """Return the estimate of every number that moved, the past's levels left out."""
    own = len(problem.free.parameters)
    values, change = problem.free.expanded(fit.values[:own])
    covariance = change @ fit.covariance[:own, :own] @ change.T
    null = fit.null_directions[:, :own] @ change.T
    null = null[np.abs(null).max(axis=1, initial=0.0) > 0]
    lost = (np.abs(change) @ np.isinf(fit.std[:own])) > 0
    std = np.where(lost, np.inf, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    return fit._replace(names=problem.free.names, values=values, std=std, covariance=covariance, null_directions=null)
