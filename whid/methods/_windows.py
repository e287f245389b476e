"""Records as windows to fit: what counts, with a lead in front of it for the filters to settle."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from whid.blocks.oversampled import NODES, finer
from whid.errors import WhidError
from whid.experiments._part import Use
from whid.record import Record
from whid.signal import Floats, held
from whid.stages.cascade_fit import Window

SHORTEST = 64  # samples: a stretch below is not worth its lead


class Windows:
    """The parts of one use of records of one rate."""

    def __init__(self, records: Sequence[Record], use: Use = "estimation", lead: int = 0) -> None:
        self.records, self.use, self.lead = [record for record in records if record.using(use).any()], use, lead
        if not self.records:
            raise WhidError("method-no-data", f"no record has samples for {use}")
        rates = {round(record.dt, 15) for record in self.records}
        if len(rates) > 1:
            raise WhidError("method-rates", f"records of {len(rates)} sampling times: {sorted(rates)} s")
        self.dt = self.records[0].dt
        self._finer: dict[tuple[int, int], Floats] = {}

    @cached_property
    def stretches(self) -> list[tuple[int, int, int]]:
        """Return (record, start, stop) of every unbroken stretch, the longest first."""
        found = []
        for k, record in enumerate(self.records):
            edges = np.flatnonzero(np.diff(record.using(self.use).astype(int), prepend=0, append=0))
            found += [(k, int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= SHORTEST]
        if not found:
            raise WhidError("stage-too-short", f"no unbroken stretch of {SHORTEST} samples for {self.use}")
        return sorted(found, key=lambda item: item[1] - item[2])

    @property
    def signals(self) -> list[tuple[Floats, Floats]]:
        """Return (u, y) of every stretch."""
        return [(self.records[k].u[a:b], self.records[k].y[a:b]) for k, a, b in self.stretches]

    @property
    def periods(self) -> list[tuple[Floats, Floats]]:
        """Return (u, y), each (periods, samples), of every multisine of the commonest period, its lead left out."""
        found: dict[int, list[tuple[Floats, Floats]]] = {}
        for record in self.records:
            counts = record.using(self.use)
            for part in record.select("multisine", self.use):
                period, lead = part.period, part.lead_periods  # type: ignore[attr-defined]
                start, stop = (part.start or 0) + lead * period, part.stop or 0
                whole = slice(start, start + (stop - start) // period * period)
                if whole.stop - start >= 2 * period and counts[whole].all():
                    pair = (record.u[whole].reshape(-1, period), record.y[whole].reshape(-1, period))
                    found.setdefault(period, []).append(pair)
        return max(found.values(), key=len, default=[])

    @property
    def longest(self) -> int:
        """Return the length of the longest stretch."""
        return self.stretches[0][2] - self.stretches[0][1]

    @property
    def samples(self) -> int:
        """Return how many samples there are."""
        return sum(int(record.using(self.use).sum()) for record in self.records)

    def first(self, samples: int, factor: int = 1) -> list[Window]:
        """Return the beginning of the longest stretch, or everything where that is not longer."""
        k, start, stop = self.stretches[0]
        if samples >= stop - start:
            return self.every(factor)
        return [self._window(k, start, start + samples, factor)]

    def every(self, factor: int = 1) -> list[Window]:
        """Return one window a record, from its first to its last sample that counts."""
        found = []
        for k, record in enumerate(self.records):
            used = np.flatnonzero(record.using(self.use))
            found.append(self._window(k, int(used[0]), int(used[-1]) + 1, factor))
        return [window for window in found if window.use.any()]

    def _window(self, k: int, start: int, stop: int, factor: int) -> Window:
        record, begin = self.records[k], max(0, start - self.lead)
        use = record.using(self.use)[begin:stop].copy()
        use[: start - begin] = False
        if begin or record.initial != "steady":
            use[: self.lead] = False  # the state before is not known
        return Window(
            self._input(k, factor)[factor * begin : factor * stop],
            record.y[begin:stop],
            use,
            factor,
            record.t0 + begin * record.dt,
        )

    def _input(self, k: int, factor: int) -> Floats:
        record = self.records[k]
        if factor == 1:
            return record.u
        if (k, factor) not in self._finer:
            course = held(record.u, record.dt, record.intersample, order=NODES)
            self._finer[k, factor] = finer(course, factor).values
        return self._finer[k, factor]
