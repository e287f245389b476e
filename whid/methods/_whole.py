"""The last stage of a method with a hard nonlinearity: every number from every sample, borders and degrees anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly

from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.errors import WhidError
from whid.fit import Estimate
from whid.methods._fewer import HOPELESS, fewer
from whid.methods._method import Model
from whid.quantity import Measured, Quantity, Table
from whid.record import Record
from whid.refine import Refined, gains, profile, refine
from whid.residual import residual
from whid.signal import Floats, rms
from whid.stages._whiten import Bools, autoregression, whitened
from whid.system import System

PRICE = 10.8  # χ² a number must be worth, as in the segmentation of the levels
ITERATIONS = 12  # for a trial: from a good start six are enough
SAME = 1.02  # growth of the residual up to which prewhitening found noise; beyond, it hides what the model lacks
PLACES = 24  # tried for a jump inside its gap: the cost has one narrow valley there


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
    records: Sequence[Record], model: Model, max_degree: int, *, rivals: Sequence[System] = (), told: bool = False
) -> tuple[WholeRecord, Model]:
    """Fit all numbers of a staged model at once, trying kink against jump at every border, one degree more or less, and
    where the orders of the linear blocks were not told those of the rivals and each block with a root less.

    A jump's break starts where the transitions between levels put it in its gap. A change is kept when −2 log L falls by
    more than 10.8 a number (p = .001 of one that is none; log N of 50 000 samples, so BIC). The linear blocks keep their
    unit static gain. Source [PAPERS A, build 3 and 6].
    """
    left = [residual(model.system.tree, record)[record.using("estimation")] for record in records]
    place = next((k for k, block in enumerate(model.system.chain) if isinstance(block, Piecewise)), -1)
    start = located(model.system, records, place) if place > 0 else model.system
    search = Search(records, place, max_degree, refine(start, records, fixed=held(start, place)))
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
        borders, tuple(said), best.gauge, estimate,
    )  # fmt: skip
    return stage, model._replace(system=best.system, estimate=estimate)


@dataclass
class Search:
    """The best model so far, and what made it so."""

    records: Sequence[Record]
    place: int  # of f in the chain
    max_degree: int
    best: Refined
    decided: list[str] = field(default_factory=list)
    coloured: float = 0.0  # long-run variance of the residual over its variance; 0 where it is white

    def __post_init__(self) -> None:
        whole = [residual(self.best.system.tree, record) for record in self.records]
        use = [record.using("estimation") & np.isfinite(record.y) for record in self.records]
        ar = [autoregression(e, u) for e, u in zip(whole, use, strict=True)]
        if any(map(len, ar)):
            self.coloured = max(1.0, *(long_run(e, u, a) for e, u, a in zip(whole, use, ar, strict=True) if u.any()))

    @property
    def curve(self) -> Piecewise:
        """Return f of the best model."""
        f = self.best.system.chain[self.place]
        assert isinstance(f, Piecewise)
        return f

    def borders(self) -> None:
        """Try the other reading of every border."""
        for k, kink in enumerate(self.curve.kinks()):
            system = self._apart(k) if kink else self._together(k)
            if system is not None and self._better(system):
                self.decided.append(f"the border at {self.curve.breaks[k]:.4g} is a {'jump' if kink else 'kink'}")

    def _apart(self, k: int) -> System | None:
        """Return the kink at break k as a jump, where the transitions do not speak against every place in its gap."""
        system = located(self.best.system, self.records, self.place, (k,), away=self.curve.breaks[k])
        b = f"chain.{self.place}.breaks.{k}"
        places = np.array([p.value for s in (self.best.system, system) for p in s.tree.parameters(True) if p.name == b])
        here, there = profile(self.best.system, self.records, b, places)
        return system if there - here < HOPELESS * here / self.best.samples.sum() else None

    def _together(self, k: int) -> System | None:
        """Return the jump at break k as a kink, where it is small against its standard error and the pieces do meet."""
        f, e = self.curve, self.best.estimate
        row = np.zeros(len(e.names))
        for piece, sign in ((k, -1.0), (k + 1, 1.0)):
            for power in range(len(f.pieces[piece])):
                row[e.names.index(f"chain.{self.place}.pieces.{piece}.{power}")] = sign * f.breaks[k] ** power
        if f.jumps()[k] ** 2 > HOPELESS * (row @ e.covariance @ row):
            return None
        meeting = met(f, k, *gap(f, self.records, k))
        return None if meeting is None else replaced(self.best.system, self.place, meeting)

    def degrees(self) -> None:
        """Drop a highest power that is not worth its price; add one that would be."""
        e = self.best.estimate
        for k, piece in enumerate(self.curve.pieces):
            name = f"chain.{self.place}.pieces.{k}.{len(piece) - 1}"
            if len(piece) > 1 and (e.value(name) / e.std[e.names.index(name)]) ** 2 < self.price:
                self._change(k, piece[:-1])
        f = self.curve
        more = {k: f"chain.{self.place}.pieces.{k}.{len(p)}" for k, p in enumerate(f.pieces) if len(p) <= self.max_degree}
        grown = replace(f, pieces=tuple((*p, 0.0) if k in more else p for k, p in enumerate(f.pieces)))
        system = replaced(self.best.system, self.place, grown)
        worth = gains(system, self.records, list(more.values()), fixed=held(system, self.place))
        for k in (k for k, gain in zip(more, worth, strict=True) if gain > self.price):
            self._change(k, (*self.curve.pieces[k], 0.0))

    def _change(self, k: int, piece: tuple[float, ...]) -> None:
        f = self.curve
        pieces = (*f.pieces[:k], piece, *f.pieces[k + 1 :])
        if self._better(replaced(self.best.system, self.place, replace(f, pieces=pieces))):
            degrees = len(piece) - 1, len(f.pieces[k]) - 1
            self.decided.append("piece {} has degree {}, which the levels read as {}".format(k + 1, *degrees))

    def orders(self, rivals: Sequence[System]) -> None:
        """Try the linear blocks of every rival, which the stages could not tell from theirs, with f as it is now."""
        for rival in rivals:
            chain = (rival.chain[0], *self.best.system.chain[1:-1], rival.chain[-1])
            if self._better(replace(rival, chain=chain)):
                poles = [len(block.den or ()) - 1 for block in (chain[0], chain[-1]) if isinstance(block, Linear)]
                self.decided.append(f"front and back have {poles[0]} and {poles[1]} poles, a rival of what the stages found")

    def roots(self) -> None:
        """Take poles and zeros away as long as one is not worth its price."""
        while gone := self._without():
            self.decided.append(f"{gone} than the stages before found")

    def _without(self) -> str:
        """Take the first root away that is not worth its price, and return what it was."""
        candidates = fewer(self.best.system, self.best.estimate)
        return next((said for said, system in candidates if self._better(system)), "")

    def _better(self, system: System) -> bool:
        """Fit another structure and keep it when it is worth its price."""
        if self.best.estimate.why_stop == "interrupted":
            return False
        try:
            found = refine(system, self.records, fixed=held(system, self.place), max_iterations=ITERATIONS)
        except WhidError:
            return False
        cost = [deviance(each) + self.price * each.parameters for each in (found, self.best)]
        better = cost[0] < cost[1] and bool(np.isfinite(found.estimate.std).all())
        self.best = found if better else self.best
        return better

    @property
    def price(self) -> float:
        """Return the χ² a number must be worth; where the residual is coloured, fewer samples are independent."""
        return PRICE * max(1.0, self.coloured)


def held(system: System, place: int) -> tuple[str, ...]:
    """Return what a whole-record fit holds: static gains, and the jumps that it cannot see."""
    return unit_gain(system) + unseen_breaks(system, place)


def unit_gain(system: System) -> tuple[str, ...]:
    """Return the constant terms of the linear blocks, which hold their static gain, and the places of a table's points."""
    held = []
    for k, block in enumerate(system.chain):
        if isinstance(block, Linear) and block.num is not None and block.den is not None:
            held += [f"chain.{k}.num.{len(block.num) - 1}", f"chain.{k}.den.{len(block.den) - 1}"]
        elif block.kind == "table":
            held.append(f"chain.{k}.inputs")
    return tuple(held)


def unseen_breaks(system: System, place: int) -> tuple[str, ...]:
    """Return the jumps that no transition passes: f comes first in the chain, where a held input steps over them."""
    f = system.chain[place] if place == 0 else None
    return tuple(f"chain.0.breaks.{k}" for k in np.flatnonzero(~f.kinks())) if isinstance(f, Piecewise) else ()


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


def long_run(residual: Floats, use: Bools, ar: Floats) -> float:
    """Return the long-run variance over the variance of an autoregressive residual."""
    innovation = whitened(np.where(use, residual, 0.0)[:, None], use, ar)[use]
    return float(np.mean(innovation**2) / (1 - ar.sum()) ** 2 / np.mean(residual[use] ** 2))


def widened(estimate: Estimate, factor: float) -> Estimate:
    """Return the estimate with its variances times a factor."""
    return estimate._replace(covariance=factor * estimate.covariance, std=np.sqrt(factor) * estimate.std)


def deviance(found: Refined) -> float:
    """Return −2 log L up to a constant."""
    return float(2 * found.samples @ np.log(np.maximum(found.noise_std, 1e-300)))


def located(
    system: System, records: Sequence[Record], place: int, which: Sequence[int] = (), away: float = np.nan
) -> System:
    """Return the system with every jump (or `which` breaks) where the record wants it in its gap, not near `away`."""
    f = system.chain[place]
    assert isinstance(f, Piecewise)
    for k in which or np.flatnonzero(~f.kinks()).tolist():
        low, high = gap(f, records, k)
        places = low + (high - low) * (np.arange(PLACES) + 0.5) / PLACES
        places = places[~(np.abs(places - away) < (high - low) / PLACES)]
        cost = profile(system, records, f"chain.{place}.breaks.{k}", places)
        f = replace(f, breaks=(*f.breaks[:k], float(places[np.argmin(cost)]), *f.breaks[k + 1 :]))
        system = replaced(system, place, f)
    return system


def gap(f: Piecewise, records: Sequence[Record], k: int) -> tuple[float, float]:
    """Return the levels on either side of a break, or the neighbouring breaks where these are nearer."""
    levels = np.unique([part.level for record in records for part in record.select("hold")])  # type: ignore[attr-defined]
    marks = np.concatenate([levels, f.breaks[:k], f.breaks[k + 1 :]])
    below, above = marks[marks <= f.breaks[k]], marks[marks > f.breaks[k]]
    width = float(np.diff(levels).max(initial=0.0)) or 1.0
    low = float(below.max()) if len(below) else f.breaks[k] - width
    return low, float(above.min()) if len(above) else f.breaks[k] + width


def met(f: Piecewise, k: int, low: float, high: float) -> Piecewise | None:
    """Return f with its pieces meeting at break k, in or beside its gap; None where they do not come together there."""
    roots = poly.polyroots(poly.polytrim(poly.polysub(f.pieces[k + 1], f.pieces[k])))
    roots = roots[np.abs(np.imag(roots)) < 1e-9].real
    near = roots[(roots > 2 * low - high) & (roots < 2 * high - low)]
    if not len(near):
        return None
    b = float(near[np.argmin(np.abs(near - f.breaks[k]))])
    step = float(poly.polyval(b, f.pieces[k]) - poly.polyval(b, f.pieces[k + 1]))
    right = (f.pieces[k + 1][0] + step, *f.pieces[k + 1][1:])
    breaks = (*f.breaks[:k], b, *f.breaks[k + 1 :])
    if any(later <= earlier for earlier, later in pairwise(breaks)):
        return None
    return replace(f, breaks=breaks, pieces=(*f.pieces[: k + 1], right, *f.pieces[k + 2 :]))


def replaced(system: System, place: int, f: Piecewise) -> System:
    """Return the system with another f."""
    return replace(system, chain=(*system.chain[:place], f, *system.chain[place + 1 :]))
