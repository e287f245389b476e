"""Hammerstein-Wiener: hard or piecewise affine input nonlinearity, linear block, polynomial output nonlinearity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt

from whid.methods._method import Method, Stages
from whid.methods._piece_bench import Bench
from whid.methods._piece_readings import audited, finished, read
from whid.methods._pieces_model import model_of, shift_of
from whid.record import Record
from whid.stages._affine_fit import Levels
from whid.stages.lissajous import lissajous, paper_scale
from whid.stages.taylor import taylor
from whid.system import System

SIGN = "the sign of G is a convention: (G, f(x)) and (−G, f(−x)) are one system; here G(0) = 1"
NO_ROOT = "f(0) = 0 nowhere near the data: x = 0 is the middle of the anchor, f(0) a number"


@dataclass(frozen=True, kw_only=True)
class HammersteinWiener(Method):
    """Piecewise affine or hard h, linear G, polynomial f: from a staircase and sines on single pieces.

    y = f(G · h(u)), G(0) = 1, slope 1 on the piece that is measured best (the anchor), f(0) = 0 (normalisation unit_dc).
    The staircase gives the pieces, sines on one of them the phase of G (the output is then one static curve of the inner
    sine), f about it and |G|; levels and sines of the other pieces give h; then all numbers are fitted to all samples.
    Of a simulated plant it asks for what it needs: levels inside the gaps of the borders, a sine on every piece, sines at
    more frequencies on the anchor, a square wave where two values of h give the same level.

    degree     of f
    settle_s   settling time; left out: from the data
    rounds     of levels asked for inside the gaps
    whole_record  end with a fit of all numbers to all samples; left out: where there are at most 400 000 of them

    Source [Brouri2014].
    """

    normalisation: Literal["unit_dc"] = "unit_dc"
    degree: Annotated[int, Ge(1)] = 3
    settle_s: Annotated[float, Gt(0)] | None = None
    rounds: Annotated[int, Ge(0)] = 6
    whole_record: bool | None = None

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield settling, levels, pieces; the tests of the sines; f and G, as in the paper and jointly; h; the Model."""
        bench = Bench(list(records), self.degree, self.settle_s, self.rounds)
        yield from bench.staircase()
        yield from bench.probe()  # section 4.1: a segment with a slope
        anchor = bench.anchor()
        yield from bench.sweep(anchor)
        clear = [p for p in bench.on(anchor) if p.clear]  # section 4.2: a curve a frequency, eqs. (14)-(23)
        amplitude = np.array([abs(p.sine.phasor) for p in clear])
        yield lissajous(np.array([p.sine.omega for p in clear]), [p.static for p in clear], amplitude)
        known = bench.data()  # the same jointly
        here = known.levels.piece == anchor
        own = Levels(*(each[here] for each in known.levels))
        mine = [p for p in bench.probes if p.usable and p.piece == anchor]
        series, first = taylor(own, known.tones.of(known.tones.piece == anchor), self.degree, [p.phases for p in mine])
        yield series
        reading = read(bench, known, first)  # section 4.3: the other segments
        if len(reading.pieces.ambiguous):
            reading = yield from audited(bench, known, first, reading)
        yield reading.pieces
        root = shift_of(reading.fit)
        yield paper_scale(reading.fit, reading.pieces.estimate, root or 0.0)
        yield reading.linear
        missing = (SIGN,) if root is not None else (SIGN, NO_ROOT)
        yield from finished(bench, reading, model_of(*reading)._replace(missing=missing), self.whole_record)
