"""What the raw output shows before any model: its lattice, its rails, samples that hang, samples that stand alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.diagnostics.isolated import isolated
from whid.diagnostics.lattice import lattice
from whid.diagnostics.rails import Rail, rails
from whid.diagnostics.standing import frozen
from whid.effects._sites import Sites
from whid.record import Record
from whid.system import System

Bools = NDArray[np.bool_]


class Raw(NamedTuple):
    """One record's output, looked at without a model.

    step      of the lattice on which every value lies, None: there is none
    rails     the ends that it meets again and again, to the last digit
    frozen    (N,) samples that repeat the one before
    isolated  (N,) samples that stand alone
    suspect   (N,) what leaves the base fit: all of these, but for rails where the declared model has its own
    """

    record: str
    step: float | None
    rails: tuple[Rail, ...]
    frozen: Bools
    isolated: Bools
    suspect: Bools

    @property
    def railed(self) -> bool:
        """Tell whether there are rails that the declared model has not."""
        return any(self.suspect[rail.at].any() for rail in self.rails)

    @property
    def words(self) -> Iterator[str]:
        """Yield what there is to say."""
        if self.step is not None:
            yield f"{self.record}: every output is a multiple of {self.step:.6g}"
        for rail in self.rails:
            away = "" if self.suspect[rail.at].any() else ", as declared"
            yield f"{self.record}: {int(rail.at.sum())} samples at {rail.level:.6g} exactly: a rail{away}"
        if self.frozen.any():
            yield f"{self.record}: {int(self.frozen.sum())} samples repeat the one before: the sensor hangs"
        if self.isolated.any():
            yield f"{self.record}: {int(self.isolated.sum())} samples stand alone"
        if self.suspect.any():
            yield f"{self.record}: {int(self.suspect.sum())} of {len(self.suspect)} samples had no part in the first fit"


def forensics(system: System, records: Sequence[Record]) -> tuple[Raw, ...]:
    """Return what every record's output shows by itself."""
    declared = Sites(system, (0, len(system.series))).railed
    found = []
    for record in records:
        y, use = record.y, record.mask & np.isfinite(record.y)
        ends = tuple(end for end in rails(y, record.u, use) if end is not None)
        hanging, alone = frozen(y, record.u, use), isolated(y, record.u, use)
        suspect = hanging | alone
        for end in () if declared else ends:
            suspect = suspect | end.at
        found.append(Raw(record.name, lattice(y[use]), ends, hanging, alone, suspect))
    return tuple(found)


def without_suspects(records: Sequence[Record], raw: Sequence[Raw]) -> tuple[Record, ...]:
    """Return records whose suspect samples do not count."""
    return tuple(
        replace(r, valid=r.mask & ~each.suspect) if each.suspect.any() else r for r, each in zip(records, raw, strict=True)
    )
