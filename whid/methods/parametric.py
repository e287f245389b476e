"""Filter, static curve, filter, from any excitation: nothing is known but the data."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge

from whid.errors import WhidError
from whid.fit import Estimate
from whid.methods._method import Method, Stages
from whid.methods._sampled import from_cascade, with_tone
from whid.methods._windows import Windows
from whid.record import Record
from whid.stages._cascade import Cascade, Filter
from whid.stages.allocation import Allocation, Split, allocation
from whid.stages.best_linear import SHORT, BestLinear, Complexes, best_linear, local_polynomial, realisations
from whid.stages.between_samples import between_samples
from whid.stages.cascade_fit import Window, bic, by_bend, cascade_fit, curve_through, evenly, reached, rms_error
from whid.stages.descent import Step, descent
from whid.stages.interference import interference
from whid.stages.linear_fit import LinearFit, alternatives, linear_fit, matched
from whid.system import System

FEW, SOME = 10_000, 20_000  # samples of the first and of the second descent
KNOTS = (8, 12, 20, 30)  # tried in turn while BIC falls
FINALISTS = 2  # splits that are refined with more knots
FASTEST = 8  # times the record's rate, at most
REALISATIONS = 4  # multisines with phases of their own, from which on their scatter tells the distortion
WORTH = 0.995  # of the error that a doubled rate may leave at most
TOTALS = range(1, 9)  # poles of the linear approximation that are tried


@dataclass(frozen=True, kw_only=True)
class Nonlinearity:
    """The static curve: `spline` (smooth) or `hinges` (straight lines between free knots); knots left out: by BIC."""

    kind: Literal["spline", "hinges"] = "spline"
    knots: Annotated[int, Ge(3)] | None = None


@dataclass(frozen=True, kw_only=True)
class Parametric(Method):
    """Filter, static curve, filter, from any excitation that moves: noise, multisine, steps.

    y = G_back · f(G_front · u), G_front(0) = G_back(0) = 1. Best linear approximation, rational fit, all splits of its poles
    and zeros between front and back scored by linear least squares, the best few refined on more and more data; Wiener and
    Hammerstein systems are the splits that leave one side empty. The last choice is by the error on selection parts, where
    there are some, otherwise by BIC. Aliasing between the samples is looked for, and where it is
    found the blocks run at twice the record's rate.

    orders         poles of front and back; left out: from the data
    nonlinearity   the static curve
    interference   auto: a steady tone in the residual, with its harmonics, is added to the model; none: not looked for
    oversampling   1, 2, …: the blocks' rate over the record's; left out: from the data
    seed           of the random starts of the rational fit
    """

    orders: tuple[Annotated[int, Ge(0)], Annotated[int, Ge(0)]] | None = None
    nonlinearity: Nonlinearity = Nonlinearity()
    interference: Literal["auto", "none"] = "auto"
    oversampling: Annotated[int, Ge(1)] | None = None
    seed: Annotated[int, Ge(0)] = 0

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield best linear approximation, linear fit, allocation, aliasing, descent; the Model last."""
        data, way = Windows(records), _Way([])
        bla, fits = self._linear(data)
        yield bla
        yield fits[0]
        data.lead = min(_settled(fits[0]), data.longest // 4)
        shared = [self._shared(data, fit, bla) for fit in fits]
        best = min(shared, key=lambda found: found.rms[0])
        yield best
        few = data.first(FEW)
        starts = [self._start(split) for found in shared for split in found.best]
        ends = [way.down(few, evenly(start, reached(few, start), KNOTS[0])) for start in starts]
        some = data.first(SOME)
        finalists = [self._grown(some, end, way) for end in self._finalists(sorted(ends, key=lambda end: bic(few, end)))]
        kept_back = Windows(records, "selection", data.lead).every() if _has(records, "selection") else None
        cascade = min(finalists, key=lambda end: rms_error(kept_back, end) if kept_back else bic(some, end))
        if data.records[0].intersample in ("bandlimited", "foh"):
            yield between_samples(some[0], cascade, data.dt)
        cascade, factor = self._oversampled(data, cascade, bla, way)
        every, knots = data.every(factor), len(cascade.curve.parameters())
        if self.nonlinearity.kind == "spline":
            cascade = by_bend(cascade, reached(every, cascade), knots)
        cascade = way.down(every, cascade)
        yield descent(way.steps)
        low, high = reached(every, cascade)
        beyond = f"the curve below {low:.4g} and above {high:.4g}: no sample went there, it goes on straight"
        found = from_cascade(cascade, way.estimate, factor, data.dt, (beyond,))
        if self.interference == "auto" and len(every) == 1:  # a phase does not carry over from record to record
            tones = interference(every[0].y - cascade.response(every[0].u)[::factor], every[0].use, data.dt, every[0].t0)
            yield tones
            found = with_tone(found, tones) if tones.found else found
        yield found

    def _linear(self, data: Windows) -> tuple[BestLinear, list[LinearFit]]:
        """Return the linear approximation and its fit of the total order given, or the three fits of the best BIC.

        Where no stable fit goes through Welch's response of a short record, the local polynomial's is taken.
        """
        rng = np.random.default_rng(self.seed)
        totals = TOTALS if self.orders is None else [sum(self.orders)]
        periods = data.periods
        many = len(periods) >= REALISATIONS
        bla = realisations(periods, data.dt) if many else best_linear(data.signals, data.dt)
        fits = [fit for total in totals if (fit := _fitted(bla, total, rng)) is not None]
        if not fits and data.samples < SHORT:
            bla = local_polynomial(*data.signals[0], data.dt)
            fits = [fit for total in totals if (fit := _fitted(bla, total, rng)) is not None]
        fits = fits or [linear_fit(bla, totals, rng)]  # its fault says what is wrong
        return bla, sorted(fits, key=lambda fit: float(fit.bic.min()))[:3]

    def _shared(self, data: Windows, fit: LinearFit, bla: BestLinear) -> Allocation:
        window = data.first(FEW)[0]
        return allocation(window.u, window.y, window.use, _roots(data, fit, bla), self.orders)

    def _finalists(self, ranked: list[Cascade]) -> list[Cascade]:
        """Return the best splits of the orders given; otherwise the best of each structure."""
        if self.orders is not None:
            return ranked[:FINALISTS]
        best: dict[tuple[int, int], Cascade] = {}
        for cascade in ranked:
            best.setdefault((len(cascade.front.den), len(cascade.back.den)), cascade)
        return list(best.values())[: FINALISTS + 1]

    def _start(self, split: Split) -> Cascade:
        """Return the cascade of a split, each side with room for as many zeros as poles."""
        front, back = (h.padded(len(h.den)) for h in (split.front, split.back))
        return Cascade(front, curve_through(self.nonlinearity.kind, split.points, split.heights), back)

    def _oversampled(self, data: Windows, cascade: Cascade, bla: BestLinear, way: _Way) -> tuple[Cascade, int]:
        """Return the cascade at the rate asked for, or doubled as long as the error falls, and the factor."""
        if self.oversampling is not None:
            factor = self.oversampling
            return (cascade if factor == 1 else way.down(data.first(SOME, factor), _faster(cascade, bla, factor))), factor
        factor = 1
        while factor < FASTEST and data.records[0].intersample != "discrete":
            windows = data.first(SOME, 2 * factor)
            rival = self._grown(windows, _faster(cascade, bla, 2, factor), way, len(cascade.curve.parameters()))
            if rms_error(windows, rival) > WORTH * rms_error(data.first(SOME, factor), cascade):
                break
            cascade, factor = rival, 2 * factor
        return cascade, factor

    def _grown(self, windows: list[Window], cascade: Cascade, way: _Way, fewest: int = 0) -> Cascade:
        """Return the cascade with as many knots as BIC pays for."""
        tried = (self.nonlinearity.knots,) if self.nonlinearity.knots else [k for k in KNOTS if k >= fewest]
        best: Cascade | None = None
        for knots in tried:
            grown = way.down(windows, by_bend(cascade, reached(windows, cascade), knots))
            if best is not None and bic(windows, grown) >= bic(windows, best):
                break
            best = cascade = grown
        return cascade


class _Way:
    """The steps so far, and the estimate of the last."""

    def __init__(self, steps: list[Step]) -> None:
        self.steps = steps
        self.estimate: Estimate

    def down(self, windows: list[Window], start: Cascade) -> Cascade:
        """Fit, and remember what it took."""
        began = time.perf_counter()
        cascade, self.estimate = cascade_fit(windows, start)
        each = (time.perf_counter() - began) / max(self.estimate.iterations, 1)
        samples, numbers = sum(w.samples for w in windows), len(cascade.curve.parameters())
        rms = rms_error(windows, cascade)
        self.steps.append(
            Step(samples, windows[0].factor, numbers, rms, self.estimate.iterations, each, self.estimate.why_stop)
        )
        return cascade


def _roots(data: Windows, fit: LinearFit, bla: BestLinear) -> Iterator[tuple[Complexes, Complexes]]:
    """Yield (zeros, poles) to share: those of the response, and of a short record those of a fit in time as well.

    In time the distortion of a nonlinear system weighs like noise: long records tell the poles better by their response.
    """
    yield from alternatives(fit, bla)
    if data.samples < SHORT:
        line = curve_through("spline", np.array([-1.0, 1.0]), np.array([-1.0, 1.0]) * fit.gain)
        zeros = fit.zeros[: len(fit.poles)]
        start = Cascade(Filter.of_roots(zeros, fit.poles), line, Filter(np.empty(0), np.empty(0)))
        front = cascade_fit(data.every(), start, 100)[0].front
        yield np.roots(front.num_z).astype(complex), np.roots(front.den_z).astype(complex)


def _has(records: Sequence[Record], use: str) -> bool:
    return any(record.using(use).any() for record in records)


def _fitted(bla: BestLinear, total: int, rng: np.random.Generator) -> LinearFit | None:
    try:
        return linear_fit(bla, [total], rng)
    except WhidError:  # no stable one: there are other orders
        return None


def _settled(fit: LinearFit) -> int:
    """Return the samples after which the slowest pole has forgotten all but 1e-6."""
    slowest = float(np.abs(fit.poles).max(initial=0.0))
    return int(min(2000, np.ceil(np.log(1e-6) / np.log(slowest)))) if 0 < slowest < 1 else 100


def _faster(cascade: Cascade, bla: BestLinear, factor: int, now: int = 1) -> Cascade:
    """Return the cascade at a higher rate: filters with the same response over the excited band."""
    turn = bla.omega * bla.dt / now
    fast = [matched(h.at(turn), turn / factor, len(h.num), len(h.den)) for h in (cascade.front, cascade.back)]
    return Cascade(fast[0], cascade.curve, fast[1])
