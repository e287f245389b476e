"""Wiener-Hammerstein: linear block, hard nonlinearity, linear block."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt

from whid.blocks.piecewise import Piecewise
from whid.errors import WhidError
from whid.long_record import LongRecord
from whid.methods import _assemble as assemble
from whid.methods import _missing, _visits
from whid.methods._ask_levels import ask_levels
from whid.methods._ask_sines import ask_connecting, ask_crossing
from whid.methods._long import OfLong
from whid.methods._method import Answered, Method, Model, Stages
from whid.methods._sines import (
    Sine,
    above_noise,
    degree_under,
    fit_chain,
    is_affine,
    is_smooth,
    on_each_piece,
    unseen,
)
from whid.methods._statistics import OfRecords, Statistics
from whid.methods._whole import whole_record
from whid.predict import input_signal
from whid.record import Record
from whid.signal import Floats
from whid.stages.branches import branch_gap
from whid.stages.harmonic_floor import harmonic_floor
from whid.stages.identifiability import identifiability
from whid.stages.joint import joint
from whid.stages.lags import lags
from whid.stages.levels import StaticCurve
from whid.stages.rational import Orders
from whid.stages.segmentation import Segmentation, segment
from whid.stages.stepwise import stepwise
from whid.system import System

# The harmonic-floor test reports at 1 %; the model is widened to the neighbouring pieces only on evidence this strong, for
# all sines together: a false alarm costs precision, and a sine that left its piece enough to matter shows p far below it.
LEFT = 1e-3
PRODUCT = "only the product front·back is identifiable inside one affine piece: let a sine cross a breakpoint"
MOST_SAMPLES = 200_000  # of a whole-record fit that nobody asked for


@dataclass(frozen=True, kw_only=True)
class WienerHammerstein(Method):
    """Hard nonlinearity between two linear blocks, from a staircase and sines.

    y = G_back · f(G_front · u), G_front(0) = G_back(0) = 1 (normalisation unit_dc, [Brouri2019] eqs. (3.1)-(3.2)).
    The staircase gives f (levels, then polynomial pieces with jumps and kinks), sines on a smooth piece give both linear
    blocks: step by step as the paper does, then jointly. With a staircase alone the dynamics are a lag on one side of f.

    degree     highest degree of a piece
    orders     poles of front and back; left out: zeros and poles as in a declared `model:` (its numbers are not
               needed), without one from the data
    settle_s   settling time; left out: from the data
    harmonics  highest harmonic that is looked at
    whole_record  end with a fit of all numbers to all samples; left out: where there are at most 200 000 of them
    """

    normalisation: Literal["unit_dc"] = "unit_dc"
    degree: Annotated[int, Ge(0)] = 3
    orders: tuple[Annotated[int, Ge(0)], Annotated[int, Ge(0)]] | None = None
    settle_s: Annotated[float, Gt(0)] | None = None
    harmonics: Annotated[int, Ge(2)] = 20
    whole_record: bool | None = None

    def __call__(self, records: Sequence[Record | LongRecord], model: System | None = None) -> Stages:
        """Yield settle, levels, branch gap, pieces; then either the sine stages or the lags; the Model last."""
        whole = [record for record in records if isinstance(record, Record)]
        return self.staged(OfRecords(whole) if len(whole) == len(records) else OfLong(records, self.harmonics), model)

    def whole_records(self) -> str:
        """Return that a fit of all samples was asked for."""
        return "whole_record: true fits all samples at once" if self.whole_record else ""

    def staged(self, seen: Statistics, model: System | None = None) -> Stages:
        """Yield the same from the statistics of records, whoever made them."""
        if sum(1 for record in seen.records for _ in record.select("hold")) < 2:
            raise WhidError("method-no-levels", "wiener_hammerstein needs a staircase: two constant levels or more")
        settles = [] if self.settle_s else seen.settles()
        yield from settles
        seconds = self.settle_s or max(settle.settle for settle in settles)
        noise, curve, pieces = self._read(seen, seconds)
        first = seen

        def read(known: Sequence[Record]) -> tuple[StaticCurve, Segmentation]:
            joined = first.joined(known[len(first.records) :])
            return self._read(joined, self._seconds(joined, seconds))[1:]

        more, vain = yield from ask_levels(seen.records, curve, pieces, read, self.degree)
        if more:
            seen = first.joined(more)
            seconds = self._seconds(seen, seconds)
            noise, curve, pieces = self._read(seen, seconds)
        yield curve
        if {1.0, -1.0} <= set(curve.direction):
            yield branch_gap(curve)
        yield pieces
        sines = seen.sines(seconds, self.harmonics, noise)
        for sine in sines:
            yield sine.harmonics
        heard = [sine for sine in sines if sine.harmonics.heard]
        said = _missing.left_out(seen.records, settles, sines, heard) + tuple(vain)
        if heard:
            declared = assemble.orders_of(model) if model else None
            orders = (0, self.orders[0], 0, self.orders[1]) if self.orders else declared
            yield from self._from_sines(
                seen, curve, pieces, heard, orders, said, lambda more: self._heard(more, seconds, noise), seconds
            )
        elif not pieces.degrees.any() and not len(pieces.breaks):
            low, high = curve.level.min(), curve.level.max()
            raise WhidError(
                "method-still-output", f"the output rests at {pieces.coefficients[0, 0]:.4g} from {low:.4g} to {high:.4g}"
            )
        elif not seen.sampled:
            raise WhidError("statistics-only", "no sine stands out of the noise: what is left are steps, sample by sample")
        else:
            yield from self._from_steps(seen.records, curve, pieces, seconds, said)

    def wants_samples(self, samples: int) -> str:
        """Return why levels and harmonics do not suffice for so many samples, "" where they do."""
        if self.settle_s is None:
            return "the settling time is read from the samples: declare `identify.settle_s`"
        if self._whole(samples):
            return "the whole-record fit reads every sample: `identify.whole_record: false`"
        return ""

    def reads(self) -> tuple[float, int]:
        """Return the declared settling time and the highest harmonic."""
        return self.settle_s or 0.0, self.harmonics

    def _read(self, seen: Statistics, settle: float) -> tuple[dict[float, Floats], StaticCurve, Segmentation]:
        """Return the noise's autoregression by sampling time, the static curve, and its pieces."""
        curves = seen.curves(settle)
        curve = _visits.joined(list(curves.values()))
        return {dt: one.ar for dt, one in curves.items()}, curve, segment(curve, max_degree=self.degree)

    def _seconds(self, seen: Statistics, before: float) -> float:
        """Return the settling time: levels that were asked for are reached by larger steps, which show more of it.

        Records that are not in memory are not read through for it once more.
        """
        if self.settle_s or not seen.sampled:
            return before
        return max(settle.settle for settle in seen.settles())

    def _heard(self, record: Record, settle: float, noise: dict[float, Floats]) -> list[Sine]:
        """Return the sines of a record that stand out of the noise."""
        return [sine for sine in OfRecords([record]).sines(settle, self.harmonics, noise) if sine.harmonics.heard]

    def _from_sines(
        self,
        seen: Statistics,
        curve: StaticCurve,
        pieces: Segmentation,
        sines: Sequence[Sine],
        orders: Orders | None,
        said: tuple[str, ...],
        heard: Callable[[Record], list[Sine]],
        settle: float,
    ) -> Stages:
        """The paper's second part: sines inside a smooth piece; those that would connect the phases are asked for."""
        left = yield from _floors(sines, pieces)
        data, fit = fit_chain(sines, pieces, curve, left, seen.samples, orders)
        dt, reach = seen.records[0].dt, (float(curve.level.min()), float(curve.level.max()))
        wanted = ask_connecting(sines, dt, data, fit, pieces, settle) or ask_crossing(sines, dt, data, pieces, reach, settle)
        if wanted:
            answer = yield wanted
            new = heard(answer) if answer else []
            for sine in new:
                yield sine.harmonics
            if answer is None or not new:
                said += (wanted.reason,) if not is_affine(data.static) else ()
            else:
                seen, sines = seen.joined([answer]), [*sines, *new]
                left += yield from _floors(new, pieces)
                data, fit = fit_chain(sines, pieces, curve, left, seen.samples, orders)
                yield Answered(f"{len(new)} sines stand out of the noise and take part")
        static, responses = data.static, data.responses
        yield identifiability(responses.omega, [[k for k in ks if k] for ks in responses.orders])
        if all(is_smooth(pieces, sine) for sine in sines) and not any(left):
            for same in on_each_piece(static, above_noise(responses)):
                yield stepwise(static, same)
        yield fit
        if not is_affine(static):
            yield joint(static, above_noise(responses), fit, data.crossed)
        missing = said + _missing.of_sines(any(left), data, fit)
        staged = assemble.from_rational(fit, static, pieces, self.normalisation, missing)
        assumed = tuple(pieces.assumed(unseen(pieces, data)))
        rivals = None if orders else assemble.rivals_of(fit, staged.system)
        told = (orders[1], orders[3]) if orders else None
        sharings = assemble.sharings_of(staged.system, told) if is_affine(static) else []
        yield from self._finished(seen, staged, assumed, rivals, sharings)

    def _from_steps(
        self, records: Sequence[Record], curve: StaticCurve, pieces: Segmentation, settle: float, said: tuple[str, ...]
    ) -> Stages:
        """What a staircase alone tells: the transitions between levels."""
        record = max(records, key=lambda r: sum(part.length for part in r.select("hold")))
        f = assemble.static_block(curve, pieces)
        holds = list(record.select("hold"))
        number = np.full(len(record), -1)
        for k, part in enumerate(holds):
            if k or record.initial == "steady":  # else the first one settles from a state that nobody knows
                number[part.start : part.stop] = k
        number[~record.using("estimation")] = -1
        found = lags(input_signal(f, record), np.nan_to_num(record.y), f, number, settle)
        yield found
        missing = said + _missing.of_steps(found)
        staged = assemble.from_lags(found, f, pieces, curve.noise_std, self.normalisation, missing)
        yield from self._finished(OfRecords(records), staged, tuple(pieces.assumed()), [])

    def _whole(self, samples: int) -> bool:
        """Tell whether a whole-record fit is wanted of so many samples."""
        return samples <= MOST_SAMPLES if self.whole_record is None else self.whole_record

    def _finished(
        self,
        seen: Statistics,
        staged: Model,
        assumed: tuple[str, ...],
        rivals: list[System] | None,
        sharings: Sequence[System] = (),
    ) -> Stages:
        """Yield the whole-record fit, where it is wanted and can tell front from back, and the Model.

        rivals: systems with other orders that the stages could not tell apart; None where the orders were told. sharings:
        with the same dynamics in front of f or behind it, where the stages could not tell these apart.
        """
        unsaid = staged._replace(missing=(*staged.missing, *assumed, *((PRODUCT,) if sharings else ())))
        curved = any(isinstance(block, Piecewise) and block.breaks for block in staged.system.chain)
        if not (seen.sampled and self._whole(seen.samples)) or (sharings and not curved):
            yield unsaid
            return
        others = {"sharings": sharings, "rivals": rivals or ()}
        try:
            found, model = whole_record(seen.records, staged, self.degree, **others, told=rivals is None)
        except (WhidError, ValueError, np.linalg.LinAlgError) as fault:  # the stages before it still stand
            yield unsaid._replace(missing=(*unsaid.missing, f"the whole-record fit failed: {fault}"))
            return
        yield found
        yield model._replace(missing=model.missing + found.gauge)
        if found.estimate.why_stop == "interrupted":
            raise KeyboardInterrupt


def _floors(sines: Sequence[Sine], pieces: Segmentation) -> Generator[Any, Record | None, list[bool]]:
    """Yield the harmonic-floor test of every sine on a smooth piece; return which have left theirs."""
    left = [False] * len(sines)
    for i, sine in enumerate(sines):
        if is_smooth(pieces, sine):
            floor = harmonic_floor(sine.harmonics, degree_under(pieces, sine))
            yield floor
            left[i] = floor.p < LEFT / len(sines)
    return left
