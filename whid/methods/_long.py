"""Levels and harmonics of records too long for memory: each is read once for the settling time and once for all the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from whid.experiments._part import Part
from whid.long_record import LongRecord
from whid.methods._sines import Sine
from whid.record import Record, used
from whid.signal import Floats, Ints
from whid.stages._hold_sums import HoldSums
from whid.stages._inner_harmonics import held_sine
from whid.stages._period_blocks import PeriodBlocks
from whid.stages.levels import StaticCurve, curve_of, first_settled
from whid.stages.settle import Settle, cuts_of, settle_of, used_of

KEPT = 1 << 18  # samples of all holds together that tell their noise

Long = Record | LongRecord


class OfLong:
    """Statistics (`_statistics.Statistics`) of records in chunks: of records that would fit they are those of `OfRecords`.

    Where the holds together are longer than 262 144 samples, the noise's colour is that of the first settled ones of each,
    where a sine is longer than 1 048 576 its noise is averaged over blocks; means and harmonics are those of all samples.
    highest: harmonic that will be asked for
    """

    sampled = False

    records: Sequence[Any]

    def __init__(self, records: Sequence[Long], highest: int, known: dict[tuple[int, float], _Seen] | None = None) -> None:
        self.records, self.highest = records, highest
        self.known: dict[tuple[int, float], _Seen] = {} if known is None else known  # by record and settling time
        self.settle = 0.0

    def joined(self, more: Sequence[Long]) -> OfLong:
        """Return the statistics of more records; what is known of these is not read again."""
        found = OfLong([*self.records, *more], self.highest, self.known)
        found.settle = self.settle
        return found

    @property
    def samples(self) -> int:
        """Return the number of samples for estimation."""
        return sum(self._seen(record, self.settle).samples for record in self.records)

    def settles(self) -> list[Settle]:
        """Return how long the holds take to settle, by sampling time."""
        return [self._settle([r for r in self.records if r.dt == dt], dt) for dt in self._rates()]

    def curves(self, settle: float) -> dict[float, StaticCurve]:
        """Return the static curve of each sampling time."""
        self.settle = settle
        return {dt: self._curve([r for r in self.records if r.dt == dt], settle) for dt in self._rates()}

    def sines(self, settle: float, highest: int, colour: dict[float, Floats]) -> list[Sine]:
        """Return the sines and their harmonics, up to the highest that was announced."""
        found = []
        for record in self.records:
            for into, out in self._seen(record, settle).sines:
                omega = 2 * np.pi / (out.period * record.dt)
                offset, first = into.harmonics().value
                phasor = held_sine(abs(first), float(np.angle(first)), omega, record.dt, record.intersample)
                found.append(Sine(omega, float(offset.real), phasor, out.harmonics(colour.get(record.dt, np.empty(0)))))
        return found

    def _rates(self) -> list[float]:
        """Return the sampling times of the holds, the one with most holds first."""
        counts = {r.dt: sum(_count(s) for s in self.records if s.dt == r.dt) for r in self.records}
        return sorted((dt for dt, count in sorted(counts.items()) if count), key=lambda dt: -counts[dt])

    def _settle(self, records: Sequence[Long], dt: float) -> Settle:
        lengths = np.array([part.length for record in records for part in record.select("hold")])
        used = used_of(lengths)
        cuts = cuts_of(lengths[used])
        places = {int(k): cuts.places(h) for h, k in enumerate(used)}
        readers: list[HoldSums] = []
        for record in records:
            parts, mine = list(record.select("hold")), []
            for part in parts:
                number = len(readers)
                at = places.get(number, np.empty(0, np.intp))
                mine.append(HoldSums(part.length, at, part.length // 2, KEPT // len(lengths)))
                readers.append(mine[-1])
            _pass(record, [(part, _to(reader)) for part, reader in zip(parts, mine, strict=True)])
        chosen = [readers[k] for k in used]
        scale = max(reader.largest for reader in chosen)
        return settle_of([r.cumulated() for r in chosen], [r.head() for r in chosen], scale, dt)

    def _curve(self, records: Sequence[Long], settle: float) -> StaticCurve:
        parts = [part for record in records for part in record.select("hold")]
        level = np.array([part.level for part in parts])  # type: ignore[attr-defined]
        ways = {"up": 1.0, "down": -1.0}
        direction = np.array([ways.get(part.direction or "", 0.0) for part in parts])  # type: ignore[attr-defined]
        held = [reader.held() for record in records for reader in self._seen(record, settle).holds]
        return curve_of(held, level, direction, settle)

    def _seen(self, record: Long, settle: float) -> _Seen:
        """Return what one pass over a record finds, made once."""
        if (key := (id(record), settle)) not in self.known:
            self.known[key] = self._read(record, settle)
        return self.known[key]

    def _read(self, record: Long, settle: float) -> _Seen:
        first, count = first_settled(settle, record.dt), max(1, _count(record))
        none: Ints = np.empty(0, np.intp)
        holds, sines, work = [], [], []
        for part in record.select("hold"):
            holds.append(HoldSums(part.length, none, first, KEPT // count))
            work.append((part, _to(holds[-1])))
        for part in record.select("sine"):
            period = float(part.period)  # type: ignore[attr-defined]
            skip = max(int(part.lead_periods), int(np.ceil(settle / (period * record.dt))))  # type: ignore[attr-defined]
            if part.length >= (skip + 2) * period:
                highest = min(self.highest, int(period / 2 - 1))
                into, out = (PeriodBlocks(part.length, period, skip, n) for n in (1, highest))
                sines.append((into, out))
                work.append((part, _both(into, out)))
        return _Seen(holds, sines, _pass(record, work))


class _Seen(NamedTuple):
    holds: list[HoldSums]
    sines: list[tuple[PeriodBlocks, PeriodBlocks]]
    samples: int


Take = Callable[[Floats, Floats], None]


def _to(reader: HoldSums) -> Take:
    return lambda u, y: reader.add(y)


def _both(into: PeriodBlocks, out: PeriodBlocks) -> Take:
    def take(u: Floats, y: Floats) -> None:
        into.add(u)
        out.add(y)

    return take


def _pass(record: Long, work: Iterable[tuple[Part, Take]]) -> int:
    """Give every part its samples, chunk by chunk, to the end of the last; return how many there are for estimation."""
    waiting = sorted(((part.start or 0, part.stop or 0, take) for part, take in work), key=lambda one: one[0])
    end = max((stop for _, stop, _ in waiting), default=0)
    samples = sum(part.length for part in record.parts if part.use == "estimation" and (part.start or 0) >= end)
    for chunk in record.chunks():
        start, u, y = chunk
        if start >= end:
            break
        samples += int(used(record, chunk, "estimation").sum())
        stop = start + len(u)
        for first, last, take in waiting:
            if first < stop and last > start:
                here = slice(max(first - start, 0), last - start)
                take(u[here], y[here])
        waiting = [one for one in waiting if one[1] > stop]
    return samples


def _count(record: Long) -> int:
    return sum(1 for _ in record.select("hold"))
