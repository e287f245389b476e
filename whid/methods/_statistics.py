"""What the staged methods read of an experiment: its levels and the harmonics of its sines, whoever makes them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from whid.methods import _visits
from whid.methods._sines import Sine, gather
from whid.record import Record
from whid.signal import Floats
from whid.stages.levels import StaticCurve, level_means
from whid.stages.settle import Settle, settle_time


class Statistics(Protocol):
    """Levels and harmonics of an experiment: measured on records, or drawn as records would give them.

    records   what happened when; y missing where the samples were not kept
    sampled   whether there are samples to read besides the statistics
    samples   how many there were for estimation
    """

    @property
    def records(self) -> Sequence[Record]:
        """Return the records that the statistics are of."""

    @property
    def sampled(self) -> bool:
        """Tell whether the records' outputs are there to read."""

    @property
    def samples(self) -> int:
        """Return the number of samples for estimation."""

    def joined(self, more: Sequence[Record]) -> Statistics:
        """Return the statistics of more records together with these."""

    def settles(self) -> list[Settle]:
        """Return how long the holds take to settle, by sampling time."""

    def curves(self, settle: float) -> dict[float, StaticCurve]:
        """Return the static curve of each sampling time, the first `settle` seconds of a hold left out."""

    def sines(self, settle: float, highest: int, colour: dict[float, Floats]) -> list[Sine]:
        """Return the sines and their harmonics; colour: the noise's autoregression by sampling time."""


class OfVisits(ABC):
    """What follows from the samples of the holds, whether they were measured or drawn."""

    @abstractmethod
    def visits(self) -> list[_visits.Visit]:
        """Return every visit of a level with its samples."""

    def settles(self) -> list[Settle]:
        """Return how long the holds take to settle, by sampling time."""
        return [settle_time([v.y for v in same], dt) for dt, same in _visits.by_rate(self.visits()).items()]

    def curves(self, settle: float) -> dict[float, StaticCurve]:
        """Return the static curve of each sampling time: one noise model each."""
        return {dt: static_curve(same, dt, settle) for dt, same in _visits.by_rate(self.visits()).items()}


@dataclass(frozen=True, eq=False)
class OfRecords(OfVisits):
    """Statistics of records in memory."""

    records: Sequence[Record]
    sampled: bool = True

    @property
    def samples(self) -> int:
        """Return the number of samples for estimation."""
        return sum(int(record.using("estimation").sum()) for record in self.records)

    def joined(self, more: Sequence[Record]) -> OfRecords:
        """Return the statistics of more records together with these."""
        return OfRecords([*self.records, *more])

    def sines(self, settle: float, highest: int, colour: dict[float, Floats]) -> list[Sine]:
        """Return the sines and their harmonics."""
        return gather(self.records, settle, highest, colour)

    def visits(self) -> list[_visits.Visit]:
        """Return every visit of a level with its samples."""
        return _visits.visits(self.records)


def static_curve(visits: Sequence[_visits.Visit], dt: float, settle: float) -> StaticCurve:
    """Return the static curve of visits of one sampling time."""
    level, direction = np.array([v.level for v in visits]), np.array([v.direction for v in visits])
    return level_means([v.y for v in visits], level, direction, dt, settle)
