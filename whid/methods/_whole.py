"""The last stage of a method with a hard nonlinearity: every number from every sample, borders and degrees anew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.blocks.piecewise import Piecewise
from whid.fit import Estimate
from whid.methods._borders import held, located, unseen_breaks
from whid.methods._method import Model
from whid.methods._search import Search, left_over
from whid.quantity import Measured, Quantity, Table
from whid.record import Record
from whid.refine import refine
from whid.residual import residual
from whid.signal import Floats, rms
from whid.system import System

SAME = 1.02  # growth of the residual up to which prewhitening found noise; beyond, it hides what the model lacks


class WholeRecord(NamedTuple):
    """The whole-record fit: what was left over before and after, what it decided differently from the stages before it."""

    before: Annotated[float, Quantity("output")]  # rms of the residual of the staged model
    rms: Annotated[float, Quantity("output")]
    noise_std: Annotated[float, Quantity("output")]
    ar: Annotated[Floats, Quantity("1", ("lag",))]
    samples: int
    borders: tuple[str, ...]  # jump or kink
    decided: tuple[str, ...]
    gauge: tuple[str, ...]
    estimate: Estimate

    def table(self) -> Table:
        """Return every number with its standard error."""
        e = self.estimate
        rows = tuple((n, Measured(float(v), float(s))) for n, v, s in zip(e.names, e.values, e.std, strict=True))
        fit = f"residual {self.before:.4g} → {self.rms:.4g} rms over {self.samples} samples"
        noise = [f"noise: autoregression of order {len(self.ar)}"] if len(self.ar) else []
        return Table(
            "Whole-record fit", ("number", "value"), rows,
            (f"{fit}; {e.iterations} iterations, {e.why_stop}", *noise, *self.decided, *self.gauge),
        )  # fmt: skip

    def metrics(self) -> dict[str, float]:
        """Return the residual before and after."""
        return {"whole_record.before.rms": self.before, "whole_record.rms": self.rms}


def whole_record(
    records: Sequence[Record],
    model: Model,
    max_degree: int,
    *,
    sharings: Sequence[System] = (),
    rivals: Sequence[System] = (),
    told: bool = False,
) -> tuple[WholeRecord, Model]:
    """Fit all numbers of a staged model at once, trying kink against jump at every border, one degree more or less, and
    where the orders of the linear blocks were not told those of the rivals and each block with a root less.

    sharings: the model with its dynamics in front of f or behind it, where the sines tell the product only; the
    transitions between levels, which cross the borders of f, tell them apart, or else the stage says so. A jump's break
    starts where the transitions between levels put it in its gap. A change is kept when −2 log L falls by more than 10.8 a
    number (p = .001 of one that is none; log N of 50 000 samples, so BIC). The linear blocks keep their unit static gain.
    Source [PAPERS A, build 3 and 6].
    """
    left = [residual(model.system.tree, record)[record.using("estimation")] for record in records]
    place = next((k for k, block in enumerate(model.system.chain) if isinstance(block, Piecewise)), -1)
    starts = [located(system, records, place) if place > 0 else system for system in sharings or (model.system,)]
    start, *others = sorted(starts, key=lambda system: left_over(system, records))
    search = Search(records, place, max_degree, refine(start, records, fixed=held(start, place)))
    if others:
        search.sharing(others[0])
    if not told:
        search.orders(rivals)
    if place >= 0:
        search.borders()
        search.degrees()
    if not told:
        search.roots()
    best, said = search.best, search.decided
    if search.coloured and best.estimate.why_stop != "interrupted":
        white = refine(best.system, records, fixed=held(best.system, place), noise="ar")
        growth = float(np.sqrt(white.samples @ white.rms**2 / (best.samples @ best.rms**2)))
        if growth <= SAME:
            best = white
        else:
            best = best._replace(estimate=widened(best.estimate, search.coloured))
            said.append(f"the residual is no noise: errors are {np.sqrt(search.coloured):.3g} times those of white noise")
    size, noise = (float(np.sqrt(best.samples @ std**2 / best.samples.sum())) for std in (best.rms, best.noise_std))
    curve = best.system.chain[place]
    borders = tuple("kink" if kink else "jump" for kink in curve.kinks()) if isinstance(curve, Piecewise) else ()
    estimate = beside(best.estimate, model.estimate, unseen_breaks(model.system, place))
    stage = WholeRecord(
        rms(np.concatenate(left)), size, noise, best.ar[0][np.isfinite(best.ar[0])], int(best.samples.sum()),
        borders, tuple(said), (*search.open, *best.gauge), estimate,
    )  # fmt: skip
    return stage, model._replace(system=best.system, estimate=estimate)


def beside(estimate: Estimate, staged: Estimate, held: Sequence[str]) -> Estimate:
    """Return the estimate with what was held but is known from the stages, independent of the rest."""
    keep = [k for k, name in enumerate(staged.names) if name in held]
    n, m = len(estimate.names), len(keep)
    covariance = np.zeros((n + m, n + m))
    covariance[:n, :n], covariance[n:, n:] = estimate.covariance, staged.covariance[np.ix_(keep, keep)]
    return estimate._replace(
        names=(*estimate.names, *(staged.names[k] for k in keep)), covariance=covariance,
        values=np.append(estimate.values, staged.values[keep]), std=np.append(estimate.std, staged.std[keep]),
        null_directions=np.pad(estimate.null_directions, ((0, 0), (0, m))),
    )  # fmt: skip


def widened(estimate: Estimate, factor: float) -> Estimate:
    """Return the estimate with its variances times a factor."""
    return estimate._replace(covariance=factor * estimate.covariance, std=np.sqrt(factor) * estimate.std)
