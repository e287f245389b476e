"""What the figures of [Brouri2019] share: one run of the study, its staircase and sines, the true curve."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from whid.blocks.piecewise import Piecewise
from whid.papers._exhibit import Bench
from whid.predict import predict
from whid.quantity import Measured
from whid.record import Record
from whid.result import Result
from whid.signal import Floats

LOST = "The figure is lost: redrawn from our plant, whose f outside [1, 3] is our own choice."


class Sine(NamedTuple):
    """One sine of a record: time from its start, output, output without noise, samples a period, periods left out."""

    time: Floats
    y: Floats
    true: Floats
    period: int
    lead: int

    def average(self, signal: Floats) -> Floats:
        """Return x̂ over one period, (3.25a), the first periods left out."""
        return np.asarray(signal[self.lead * self.period :].reshape(-1, self.period).mean(axis=0))


def one_run(bench: Bench, whole: bool = False) -> Result:
    """Return the first run of the study, staged only or with the whole-record fit; raise the fault that stopped it."""
    options: Any = bench.method
    found = next(bench.results(1, identify=replace(options, whole_record=whole)))
    _ = found.model  # of a run that failed its fault
    return found


def true_curve(bench: Bench) -> Piecewise:
    """Return f between blocks of static gain 1."""
    assert bench.plant is not None
    return cast(Piecewise, next(block for block in bench.plant.chain if block.kind == "piecewise"))


def staircase(record: Record) -> slice:
    """Return the samples of the holds, which come first."""
    return slice(0, max(part.stop or 0 for part in record.select("hold")))


def sine(bench: Bench, record: Record, number: int = 0) -> Sine:
    """Return one of the sines; settled periods only are averaged."""
    assert bench.plant is not None
    part: Any = list(record.select("sine"))[number]
    place = slice(part.start, part.stop)
    clean: Floats = predict(bench.plant.tree, record)[place]
    period = round(part.period)
    return Sine(record.time[place] - record.time[part.start], record.y[place], clean, period, part.lead_periods)


def parameter(result: Result, name: str) -> Measured:
    """Return a number of the model with its standard error."""
    estimate = result.model.estimate
    place = estimate.names.index(name)
    return Measured(float(estimate.values[place]), float(estimate.std[place]))
