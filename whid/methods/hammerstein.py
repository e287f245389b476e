"""Hammerstein: hard or piecewise affine input nonlinearity, linear block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt

from whid.methods._method import Method, Stages
from whid.methods._piece_bench import Bench
from whid.methods._piece_readings import finished, read
from whid.methods._pieces_model import model_of
from whid.record import Record
from whid.stages._affine_fit import Levels
from whid.stages.taylor import taylor
from whid.system import System


@dataclass(frozen=True, kw_only=True)
class Hammerstein(Method):
    """Piecewise affine or hard h, linear G: Hammerstein-Wiener without an output nonlinearity.

    y = G · h(u), G(0) = 1 (normalisation unit_dc): h is the static curve itself. Sines on single pieces give G, one sine
    a piece; their output is a sine, which is tested: harmonics say that there is an output nonlinearity after all. Asks for
    levels and sines as `hammerstein_wiener` does.

    settle_s   settling time; left out: from the data
    rounds     of levels asked for inside the gaps
    whole_record  end with a fit of all numbers to all samples; left out: where there are at most 400 000 of them

    Source [Brouri2014], section 1 ("applied directly to Hammerstein").
    """

    normalisation: Literal["unit_dc"] = "unit_dc"
    settle_s: Annotated[float, Gt(0)] | None = None
    rounds: Annotated[int, Ge(0)] = 6
    whole_record: bool | None = None

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield settling, levels, pieces; the tests of the sines; G; h; the Model."""
        bench = Bench(list(records), 1, self.settle_s, self.rounds)
        yield from bench.staircase()
        yield from bench.probe()
        anchor = bench.anchor()
        yield from bench.sweep(anchor)
        known = bench.data()
        here = known.levels.piece == anchor
        mine = [p for p in bench.probes if p.usable and p.piece == anchor]
        own = Levels(*(each[here] for each in known.levels))
        series, first = taylor(own, known.tones.of(known.tones.piece == anchor), 1, [p.phases for p in mine])
        yield series
        reading = read(bench, known, first)
        yield reading.pieces
        yield reading.linear
        yield from finished(bench, reading, model_of(*reading, plain=True), self.whole_record)
