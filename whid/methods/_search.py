"""The search for the structure that a whole-record fit pays for: borders, degrees, orders and roots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import polynomial as poly

from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.errors import WhidError
from whid.methods._borders import gap, held, located, met, replaced
from whid.methods._fewer import HOPELESS, fewer
from whid.record import Record
from whid.refine import Refined, gains, profile, refine
from whid.residual import residual
from whid.signal import Floats
from whid.stages._whiten import Bools, autoregression, whitened
from whid.system import System

PRICE = 10.8  # χ² a number must be worth, as in the segmentation of the levels
ITERATIONS = 12  # for a trial: from a good start six are enough


@dataclass
class Search:
    """The best model so far, and what made it so."""

    records: Sequence[Record]
    place: int  # of f in the chain
    max_degree: int
    best: Refined
    decided: list[str] = field(default_factory=list)
    coloured: float = 0.0  # long-run variance of the residual over its variance; 0 where it is white
    open: list[str] = field(default_factory=list)  # what it could not decide

    def __post_init__(self) -> None:
        self._listen()

    def _listen(self) -> None:
        """Hear what colour the residual of the best model has."""
        whole = [residual(self.best.system.tree, record) for record in self.records]
        use = [record.using("estimation") & np.isfinite(record.y) for record in self.records]
        ar = [autoregression(e, u) for e, u in zip(whole, use, strict=True)]
        self.coloured = 0.0
        if any(map(len, ar)):
            self.coloured = max(1.0, *(long_run(e, u, a) for e, u, a in zip(whole, use, ar, strict=True) if u.any()))

    @property
    def curve(self) -> Piecewise:
        """Return f of the best model."""
        f = self.best.system.chain[self.place]
        assert isinstance(f, Piecewise)
        return f

    def sharing(self, rival: System) -> None:
        """Take the sharing of the dynamics between front and back that leaves less, and say where two leave alike."""
        found = self._fitted(rival)
        if found is None:
            return
        self.best, other = sorted((self.best, found), key=deviance)
        self._listen()
        if deviance(other) - deviance(self.best) < self.price:
            self.open.append(f"front and back are not told apart: {shares(other.system)} would fit as well")
        else:
            self.decided.append(f"the transitions between levels tell {shares(self.best.system)}")

    def borders(self) -> None:
        """Try the other reading of every border; what no sample tells is a kink, as it is to the levels."""
        for k, kink in enumerate(self.curve.kinks()):
            told = self._told(k)
            system = self._apart(k) if kink else self._together(k)
            if system is not None and self._better(system, credit=0.0 if told else self.price):
                self.decided.append(f"the border at {self.curve.breaks[k]:.4g} is a {'jump' if kink else 'kink'}")
                if not told:
                    self.open.append(f"the border at {self.curve.breaks[k]:.4g} may be a jump: no sample is in its gap")

    def _told(self, k: int) -> bool:
        """Tell whether samples show where break k is."""
        e, name = self.best.estimate, f"chain.{self.place}.breaks.{k}"
        return name in e.names and bool(np.isfinite(e.std[e.names.index(name)]))

    def _apart(self, k: int) -> System | None:
        """Return the kink at break k as a jump, where the transitions do not speak against every place in its gap."""
        system = located(self.best.system, self.records, self.place, (k,), away=self.curve.breaks[k])
        b = f"chain.{self.place}.breaks.{k}"
        places = np.array([p.value for s in (self.best.system, system) for p in s.tree.parameters(True) if p.name == b])
        here, there = profile(self.best.system, self.records, b, places)
        return system if there - here < HOPELESS * here / self.best.samples.sum() else None

    def _together(self, k: int) -> System | None:
        """Return the jump at break k as a kink, where it is small against its standard error and the pieces do meet.

        The break has an error too, and where the pieces cross at an angle the jump is as uncertain; where no sample tells
        the break, it is anything.
        """
        f, e = self.curve, self.best.estimate
        if self._told(k):
            left, right = (float(poly.polyval(f.breaks[k], poly.polyder(piece))) for piece in f.pieces[k : k + 2])
            rates = {f"chain.{self.place}.breaks.{k}": right - left}
            for piece, sign in ((k, -1.0), (k + 1, 1.0)):
                for power in range(len(f.pieces[piece])):
                    rates[f"chain.{self.place}.pieces.{piece}.{power}"] = sign * f.breaks[k] ** power
            at, row = [e.names.index(each) for each in rates], np.array(list(rates.values()))
            if f.jumps()[k] ** 2 > HOPELESS * (row @ e.covariance[np.ix_(at, at)] @ row):
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
                self.decided.append(f"{shares(self.best.system)}, a rival of what the stages found")

    def roots(self) -> None:
        """Take poles and zeros away as long as one is not worth its price."""
        while gone := self._without():
            self.decided.append(f"{gone} than the stages before found")

    def _without(self) -> str:
        """Take the first root away that is not worth its price, and return what it was."""
        candidates = fewer(self.best.system, self.best.estimate)
        return next((said for said, system in candidates if self._better(system)), "")

    def _better(self, system: System, credit: float = 0.0) -> bool:
        """Fit another structure and keep it when it is worth its price, or lacks no more than a credit."""
        found = self._fitted(system)
        if found is None:
            return False
        cost = [deviance(each) + self.price * each.parameters for each in (found, self.best)]
        better = cost[0] < cost[1] + credit and bool(np.isfinite(found.estimate.std).all())
        self.best = found if better else self.best
        return better

    def _fitted(self, system: System) -> Refined | None:
        """Return the fit of another structure; None where there is none, or no time left."""
        if self.best.estimate.why_stop == "interrupted":
            return None
        try:
            return refine(system, self.records, fixed=held(system, self.place), max_iterations=ITERATIONS)
        except WhidError:
            return None

    @property
    def price(self) -> float:
        """Return the χ² a number must be worth; where the residual is coloured, fewer samples are independent."""
        return PRICE * max(1.0, self.coloured)


def long_run(residual: Floats, use: Bools, ar: Floats) -> float:
    """Return the long-run variance over the variance of an autoregressive residual."""
    innovation = whitened(np.where(use, residual, 0.0)[:, None], use, ar)[use]
    return float(np.mean(innovation**2) / (1 - ar.sum()) ** 2 / np.mean(residual[use] ** 2))


def deviance(found: Refined) -> float:
    """Return −2 log L up to a constant."""
    return float(2 * found.samples @ np.log(np.maximum(found.noise_std, 1e-300)))


def left_over(system: System, records: Sequence[Record]) -> float:
    """Return the sum of squares that a system leaves of the estimation parts."""
    left = [residual(system.tree, record)[record.using("estimation")] for record in records]
    return float(sum(np.nansum(e**2) for e in left))


def shares(system: System) -> str:
    """Return how many poles front and back have."""
    front, back = (len(block.den or ()) - 1 for block in (system.chain[0], system.chain[-1]) if isinstance(block, Linear))
    return f"{front} pole{'s' * (front != 1)} in front of f and {back} behind it"
