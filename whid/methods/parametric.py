"""Filters and static curves from any excitation: nothing is known but the data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, MaxLen, MinLen

from whid.blocks._static import Static
from whid.errors import WhidError
from whid.methods._descents import Descents
from whid.methods._linear_starts import filters, linear_starts, roots
from whid.methods._method import Method, Stages
from whid.methods._sampled import from_cascade, with_tone
from whid.methods._windows import Windows
from whid.record import Record
from whid.signal import Floats
from whid.stages import _forms as forms
from whid.stages._cascade import Cascade, Filter
from whid.stages.allocation import Allocation, Split, allocation
from whid.stages.best_linear import BestLinear
from whid.stages.between_samples import between_samples
from whid.stages.cascade_fit import Window, bic, errors, gauged, knotted, reached, rested, rms_error
from whid.stages.descent import descent
from whid.stages.interference import interference
from whid.stages.linear_fit import LinearFit, matched
from whid.stages.noise_floor import noise_floor
from whid.stages.static_curves import static_curves
from whid.stages.structures import better, named, structures
from whid.stages.two_curves import Between, two_curves
from whid.system import System

FEW, SOME = 10_000, 20_000  # samples of the first and of the second descent
LAST = 60  # iterations of the last descent, at most
FINALISTS = 2  # splits that are refined with more knots; one more where structures compete
FASTEST = 8  # times the record's rate, at most
WORTH = 0.995  # of the error that a doubled rate may leave at most
HOPELESS = 3.0  # times the error of the best: what leaves more is not refined
BETWEEN = 2  # starts of curve, filter, curve that are refined

Structure = Literal["auto", "wiener", "hammerstein", "wiener_hammerstein", "hammerstein_wiener"]


@dataclass(frozen=True, kw_only=True)
class Nonlinearity:
    """The static curves.

    kind    spline: smooth · hinges: straight lines between free knots · piecewise: a polynomial with free kinks ·
            saturation, dead_zone: then a straight line
    knots   of each curve (kinks of a piecewise one); left out: as many as selection data, or BIC, pay for
    degree  of a piecewise one's pieces
    soft    corners rounded over a width that is fitted; left out: those of saturation and dead_zone are, hinges not
    """

    kind: forms.Kind = "spline"
    knots: Annotated[int, Ge(1)] | None = None
    degree: Annotated[int, Ge(1)] = 2
    soft: bool | None = None

    def __post_init__(self) -> None:
        if self.kind in ("spline", "hinges") and self.knots is not None and self.knots < 3:
            raise WhidError("block-parameters", f"{self.kind} need three knots or more, not {self.knots}")

    @property
    def counts(self) -> tuple[int, ...]:
        """Return the numbers of knots that are tried in turn."""
        return forms.COUNTS[self.kind] if self.knots is None else (self.knots,)

    def drawn(self, points: Floats, heights: Floats, levels: Floats) -> tuple[Static, ...]:
        """Return the first curve through points, for the levels that arrive."""
        soft = self.kind != "hinges" if self.soft is None else self.soft
        return forms.drawn(self.kind, points, heights, levels, degree=self.degree, soft=soft)


@dataclass(frozen=True, kw_only=True)
class Parametric(Method):
    """Filters and static curves from any excitation that moves: noise, multisine, steps.

    wiener_hammerstein  y = G_back · f(G_front · u)     wiener: no back, hammerstein: no front
    hammerstein_wiener  y = g(G · f(u))                 all G(0) = 1

    Best linear approximation, rational fit, all splits of its poles and zeros between front and back scored by linear least
    squares, and one filter between two curves; the best few of every structure refined on more and more data. A larger model
    must be better on selection parts, by two standard errors, or where there are none by BIC. Aliasing between the samples
    is looked for, and where it is found the blocks run at twice the record's rate, or four times.

    structure      auto: those above compared
    orders         poles: [front, back], or [n] in all; left out: from the data
    nonlinearity   the static curves
    interference   auto: a steady tone in the residual, with its harmonics, is added to the model; none: not looked for
    oversampling   1, 2, …: the blocks' rate over the record's; left out: from the data
    seed           of the random starts of the rational fit
    """

    structure: Structure = "auto"
    orders: Annotated[tuple[Annotated[int, Ge(0)], ...], MinLen(1), MaxLen(2)] | None = None
    nonlinearity: Nonlinearity = Nonlinearity()
    interference: Literal["auto", "none"] = "auto"
    oversampling: Annotated[int, Ge(1)] | None = None
    seed: Annotated[int, Ge(0)] = 0

    def __post_init__(self) -> None:
        if self.structure == "hammerstein_wiener" and self._pair:
            raise WhidError("block-parameters", f"one filter between two curves has `orders: [n]`, not {list(self._pair)}")

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield best linear approximation, linear fit, allocation, structures, aliasing, descent, curves; the Model last."""
        data, way = Windows(records), Descents(Windows(records, "selection") if _has(records, "selection") else None)
        bla, fits = linear_starts(data, self.orders, self.seed)
        yield bla
        yield fits[0]
        data.lead = min(_settled(fits[0]), data.longest // 4)
        way.settle(data.lead)
        few, starts = data.first(FEW), []
        if self.structure != "hammerstein_wiener":
            shared = [self._shared(few[0], data, fit, bla) for fit in fits]
            yield min(shared, key=lambda found: found.rms[0])
            starts += [self._start(few[0], split) for found in shared for split in found.best]
        if self.structure == "hammerstein_wiener" or (self.structure == "auto" and self._pair is None):
            between = two_curves(few[0].u, few[0].y, few[0].use, filters(data, fits, bla))
            yield between
            starts += [self._between(few[0], start) for start in between.best[:BETWEEN]]
        ends = [way.down(few, knotted(few, start, self.nonlinearity.counts[0], by_bend=False)) for start in starts]
        some = data.first(SOME)
        ranked = sorted(ends, key=lambda end: bic(few, end))
        finalists = [self._grown(some, end, way) for end in self._finalists(ranked, few)]
        compared = structures(some, way.kept(1), finalists)
        yield compared
        cascade = finalists[compared.chosen]
        if self.orders is None:
            cascade = self._slimmed(some, cascade, bla, way)
        if data.records[0].intersample in ("bandlimited", "foh"):
            yield between_samples(some[0], cascade, data.dt)
        cascade, factor = self._oversampled(data, cascade, bla, way)
        every = data.every(factor)
        if self.nonlinearity.kind == "spline":
            cascade = knotted(every, cascade, len(cascade.curves[0].parameters()))
        cascade = rested(way.down(every, cascade, LAST))
        yield descent(way.steps)
        yield static_curves(every, cascade, way.estimate)
        yield noise_floor(list(errors(every, cascade)), data.dt)
        found = from_cascade(cascade, way.estimate, factor, data.dt, tuple(_beyond(every, cascade)))
        if self.interference == "auto" and len(every) == 1:  # a phase does not carry over from record to record
            tones = interference(every[0].y - cascade.response(every[0].u)[::factor], every[0].use, data.dt, every[0].t0)
            yield tones
            found = with_tone(found, tones) if tones.found else found
        yield found

    @property
    def _pair(self) -> tuple[int, int] | None:
        """Return the poles in front and behind, where they are given."""
        return (self.orders[0], self.orders[1]) if self.orders and len(self.orders) == 2 else None

    def _shared(self, window: Window, data: Windows, fit: LinearFit, bla: BestLinear) -> Allocation:
        total = len(fit.poles)
        fixed = {"wiener": (total, 0), "hammerstein": (0, total)}.get(self.structure, self._pair)
        both = self.structure == "wiener_hammerstein" and fixed is None
        return allocation(window.u, window.y, window.use, roots(data, fit, bla), fixed, both)

    def _finalists(self, ranked: list[Cascade], windows: list[Window]) -> list[Cascade]:
        """Return the best splits of the orders given; otherwise the best of each structure, and the best of all orders.

        What leaves far more than the first is not in the race.
        """
        if self._pair is not None:
            return ranked[:FINALISTS]
        bar = HOPELESS * rms_error(windows, ranked[0])
        able = [cascade for cascade in ranked if rms_error(windows, cascade) < bar]
        kinds = {named(cascade).partition(",")[0]: cascade for cascade in reversed(able)}
        orders = {named(cascade): cascade for cascade in reversed(able)}
        first = [cascade for cascade in orders.values() if any(cascade is kind for kind in kinds.values())]
        rest = [cascade for cascade in reversed(orders.values()) if all(cascade is not kind for kind in first)]
        return [*first, *rest][: max(len(first), FINALISTS + 1)]

    def _start(self, window: Window, split: Split) -> Cascade:
        """Return the cascade of a split, each side with room for as many zeros as poles."""
        curve = self.nonlinearity.drawn(split.points, split.heights, split.front.through(window.u))
        sides = [(h.padded(len(h.den)),) if len(h.den) + len(h.num) else () for h in (split.front, split.back)]
        return Cascade((*sides[0], *curve, *sides[1]))

    def _between(self, window: Window, start: Between) -> Cascade:
        """Return the cascade of a filter between two curves."""
        f = self.nonlinearity.drawn(start.points[0], start.heights[0], window.u)
        x = start.filter.through(np.interp(window.u, start.points[0], start.heights[0]))
        g = self.nonlinearity.drawn(start.points[1], start.heights[1], x)
        return gauged(Cascade((*f, start.filter.padded(len(start.filter.den)), *g)))

    def _oversampled(self, data: Windows, cascade: Cascade, bla: BestLinear, way: Descents) -> tuple[Cascade, int]:
        """Return the cascade at the rate asked for, or doubled as long as the error falls, and the factor."""
        if self.oversampling is not None:
            factor = self.oversampling
            return (cascade if factor == 1 else way.down(data.first(SOME, factor), _faster(cascade, bla, factor))), factor
        factor = 1
        while factor < FASTEST and data.records[0].intersample != "discrete":
            slow, windows = data.first(SOME, factor), data.first(SOME, 2 * factor)
            if factor > 1 and between_samples(slow[0], cascade, data.dt).share < 1 - WORTH:
                break
            rival = self._grown(windows, _faster(cascade, bla, 2, factor), way, len(cascade.curves[0].parameters()))
            if rms_error(windows, rival) > WORTH * rms_error(slow, cascade):
                break
            cascade, factor = rival, 2 * factor
        return cascade, factor

    def _slimmed(self, windows: list[Window], cascade: Cascade, bla: BestLinear, way: Descents) -> Cascade:
        """Return the cascade with a pole and a zero less in a filter, as long as those are not worth their numbers."""
        turn = bla.omega * bla.dt
        for k, part in enumerate(cascade.parts):
            if isinstance(part, Filter) and len(part.den):
                left = len(part.den) - 1
                fewer = (matched(part.at(turn), turn, left, left),) if left else ()
                start = gauged(Cascade((*cascade.parts[:k], *fewer, *cascade.parts[k + 1 :])))
                slimmer = way.down(windows, start)
                if not better(windows, way.kept(windows[0].factor), cascade, slimmer):
                    return self._slimmed(windows, slimmer, bla, way)
        return cascade

    def _grown(self, windows: list[Window], cascade: Cascade, way: Descents, fewest: int = 0) -> Cascade:
        """Return the cascade with as many knots as pay."""
        counts = self.nonlinearity.counts
        best: Cascade | None = None
        for knots in [k for k in counts if k >= fewest] or counts[-1:]:
            grown = way.down(windows, knotted(windows, cascade, knots))
            if best is not None and not better(windows, way.kept(windows[0].factor), grown, best):
                break
            best = cascade = grown
        return cascade


def _beyond(windows: list[Window], cascade: Cascade) -> Iterator[str]:
    """Yield what no sample tells of the curves."""
    spans = reached(windows, cascade)
    for k, (low, high) in enumerate(spans):
        name = "the curve" if len(spans) == 1 else f"curve {k + 1}"
        yield f"{name} below {low:.4g} and above {high:.4g}: no sample went there, it goes on as at its end"


def _has(records: Sequence[Record], use: str) -> bool:
    return any(record.using(use).any() for record in records)


def _settled(fit: LinearFit) -> int:
    """Return the samples after which the slowest pole has forgotten all but 1e-6."""
    slowest = float(np.abs(fit.poles).max(initial=0.0))
    return int(min(2000, np.ceil(np.log(1e-6) / np.log(slowest)))) if 0 < slowest < 1 else 100


def _faster(cascade: Cascade, bla: BestLinear, factor: int, now: int = 1) -> Cascade:
    """Return the cascade at a higher rate: filters with the same response over the excited band."""
    turn = bla.omega * bla.dt / now
    return cascade._replace(
        parts=tuple(
            matched(part.at(turn), turn / factor, len(part.num), len(part.den)) if isinstance(part, Filter) else part
            for part in cascade.parts
        )
    )
