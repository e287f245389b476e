"""The experiments that Hammerstein-Wiener identification asks for: levels, sines on one piece, a square wave between two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whid.experiments.hold import Hold
from whid.experiments.sine import Sine
from whid.experiments.square import Square
from whid.methods._method import Wanted
from whid.signal import Floats
from whid.stages.input_pieces import InputPieces
from whid.stages.transfer_function import TransferFunction

FEWEST = 16  # samples a period


def levels(where: Sequence[float], settle: float, mean_s: float, std: float, reason: str) -> Wanted:
    """Ask for constant levels, each held for two settling times and then for as long as its mean takes."""
    order = sorted(where)
    plan = [Hold(level=float(u), hold_s=2 * settle + mean_s, direction="up") for u in order]
    return Wanted(tuple(plan), reason, std, "level, output")


def sine(offset: float, amplitude: float, period: int, settle_samples: float, periods: int) -> Sine:
    """Return one sine with as many lead periods as it takes to settle."""
    lead = max(1, int(np.ceil(1.5 * settle_samples / period)))
    return Sine(offset=offset, amplitude=amplitude, period=float(period), periods=periods, lead_periods=lead)


def periods_of(omega: Floats, dt: float) -> list[int]:
    """Return whole periods in samples, each once, none shorter than 16."""
    found = np.round(2 * np.pi / (np.asarray(omega) * dt)).astype(int)
    return sorted({int(p) for p in found if p >= FEWEST}, reverse=True)


def squares(pieces: InputPieces, linear: TransferFunction, settle: float, dt: float, periods: int) -> tuple[Square, ...]:
    """Return a square wave between the middle of the anchor and that of every ambiguous piece, faster than G's corner."""
    corner = linear.corner()
    period = max(FEWEST, round(2 * np.pi / (1.5 * corner * dt)))
    lead = max(1, int(np.ceil(1.5 * settle / dt / period)))
    anchor = float(pieces.centre[pieces.anchor])
    others = [float(pieces.centre[k]) for k in pieces.ambiguous]
    return tuple(
        Square(offset=(anchor + u) / 2, amplitude=abs(anchor - u) / 2, period=period, periods=periods, lead_periods=lead)
        for u in others
    )
