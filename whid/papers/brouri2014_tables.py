"""[Brouri2014], Tables 1-3: the estimators of phase, gain and output nonlinearity, input nonlinearity, worked through."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from whid.blocks.piecewise import Piecewise
from whid.papers._brouri2014 import (
    LEAD,
    OWN_PLANT,
    PERIODS,
    SAMPLES,
    STEP,
    Segment,
    crossing_rate,
    progressive,
    stretch,
)  # fmt: skip
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.quantity import Measured
from whid.result import Result
from whid.score import linear_response
from whid.system import System


@dataclass(frozen=True, kw_only=True)
class Brouri2014Tables(Exhibit):
    """The paper's three estimators, corrected, as worked examples beside the efficient ones ([Brouri2014], Tables 1-3).

    paper's method  phase and gain from one curve a frequency, borders from sines of growing amplitude, slopes by stretch
    efficient       all levels and curves jointly, borders and slopes from all samples
    """

    omega: float = 1.0
    low: float = -3.0
    high: float = 3.0

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return phases, gains and f, then the pieces, each beside the truth."""
        plant: Any = bench.plant
        degree = len(plant.chain[-1].coefficients) - 1
        run = next(bench.results(1))
        segments, count = progressive(plant, self.low, self.high, self.omega, degree, bench.rng(1))
        rows = [*_first_two(run, plant), *_third(run, plant, segments, self.omega, degree)]
        samples = count * SAMPLES * PERIODS
        ours = sum(len(record) for record in run.records)
        rows += [
            Row("experiments", None, count, sum(len(record.parts) for record in run.records)),
            Row("samples (of the paper's search those after the leads)", None, samples, ours),
        ]
        return Regenerated(
            "Tables 1-3 of Brouri, Amdouri, Chaoui and Giri (2014), worked through",
            rows,
            (
                OWN_PLANT,
                "Scaling: slope 1 on the piece that tells the phase best, sum of |c_i|^(n/i) = 1: (16), not (15).",
                "Tables 1 and 2 use the same records for both columns. A curve whose zero lies beyond the swing is "
                "extrapolated to it: the gains of the paper's method are then off by more than the noise of the curves.",
                f"Table 3: {count} sines of {SAMPLES} samples a period, {PERIODS} periods after {LEAD}, amplitude growing "
                f"by {STEP:g}; (24) always finds a border late, the next piece then starts late as well.",
                "(28a) as printed takes slopes from crossings of the axis: it gives 1 whatever the slope.",
            ),
            headings=("published", "paper's method, ours", "efficient, ours", "truth"),
        )


def _first_two(run: Result, plant: System) -> Iterator[Row]:
    """Yield phases (Table 1), then gains and f (Table 2)."""
    f: Any = plant.chain[-1]
    c = np.array(f.coefficients[1:])
    n = len(c)
    size = float(np.sum(np.abs(c) ** (n / np.arange(1, n + 1))) ** (1 / n))
    names = [name.removeprefix("paper.") for name in run.metrics if name.startswith("paper.linear.")]
    for quantity in ("phase", "gain"):
        for name in sorted((m for m in names if f".{quantity}@" in m), key=lambda m: float(m.partition("@")[2])):
            omega = float(name.partition("@")[2])
            g = complex(linear_response(plant, np.array([omega]))[0])
            true = float(np.angle(g)) if quantity == "phase" else abs(g) * size
            table = 1 if quantity == "phase" else 2
            yield Row(f"Table {table}: {quantity} at {omega:.4g} rad/s", None, run.metrics[f"paper.{name}"],
                      run.metrics[name], true)  # fmt: skip
    for k in range(1, n + 1):
        true = float(c[k - 1] / size**k)
        yield Row(f"Table 2: c_{k}", None, run.metrics[f"paper.f.{k}"], run.metrics[f"f.{k}"], true)


def _third(run: Result, plant: System, segments: list[Segment], omega: float, degree: int) -> Iterator[Row]:
    """Yield borders and slopes (Table 3): found, jointly found, true."""
    true, found = plant.chain[0], run.model.system.chain[0]
    assert isinstance(true, Piecewise)
    assert isinstance(found, Piecewise)
    yield Row("Table 3: number of pieces", None, len(segments), len(found.pieces), len(true.pieces))
    ends = np.array([segment.end for segment in segments[:-1]])
    for k, b in enumerate(true.breaks):
        late = None if not len(ends) else float(ends[np.argmin(np.abs(ends - b))])
        yield Row(f"Table 3: d_{k + 1}", None, late and Measured(late, 2 * STEP / np.sqrt(12)), _number(run, "breaks", k), b)
    slopes = np.array([piece[1] if len(piece) > 1 else 0.0 for piece in true.pieces])
    at = int(run.stages["input_pieces"].anchor)
    anchor = _under(segments, true, at)
    edges = np.concatenate([[segments[0].start], true.breaks, [segments[-1].end]])
    rates = [
        crossing_rate(plant, a, b, omega, degree) if s else None for s, (a, b) in zip(slopes, pairwise(edges), strict=True)
    ]
    for k, slope in enumerate(slopes):
        segment = _under(segments, true, k)
        ours = _number(run, "pieces", k, 1) if slope and k != at else float(slope)
        paper: Any = "no such piece"
        if segment is not None and anchor is not None:
            paper = 0.0 if segment.flat else 1.0 if segment is anchor else stretch(anchor.last, segment.last)
        yield Row(f"Table 3: S_{k + 1}", None, paper, ours, slope)
        rate, own = rates[k], rates[at]
        if k != at and rate and own:
            yield Row(f"Table 3: S_{k + 1} by (28a) as printed, without noise", None, rate / own, None, slope)


def _under(segments: list[Segment], true: Piecewise, piece: int) -> Segment | None:
    """Return the found segment with the middle of a true piece inside its last static experiment."""
    edges = np.concatenate([[segments[0].start], true.breaks, [segments[-1].end]])
    middle = float(edges[piece : piece + 2].mean())
    return next((s for s in segments if abs(middle - s.last.offset) <= s.last.amplitude), None)


def _number(run: Result, *path: object) -> Measured | float:
    """Return a number of the model's h; without an error where it was held."""
    name = ".".join(["chain.0", *map(str, path)])
    e = run.model.estimate
    if name in e.names:
        place = e.names.index(name)
        return Measured(float(e.values[place]), float(e.std[place]))
    h: Any = run.model.system.chain[0]
    if path[0] == "breaks":  # a jump, held in its gap
        pieces = run.stages["input_pieces"]
        return Measured(float(h.breaks[path[1]]), float(pieces.break_std[path[1]]))
    return float(h.pieces[path[1]][path[2]])
