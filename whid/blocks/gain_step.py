"""A gain that changes at a moment and stays so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from whid.blocks._block import Number
from whid.blocks._clocked import Switched


@dataclass(frozen=True, kw_only=True)
class GainStep(Switched):
    """The signal, larger by a share from a moment on: an amplifier whose range was switched.

    w(t) = v(t)·(1 + height) for t ≥ at_s, v(t) before; at_s in s, the record's own time, height relative

           1 ──┐  ┌── 1 + height
               └──┘ at_s
                │
    v ────────►(×)──► w

    >>> GainStep(at_s=1.0, height=0.5)([2.0, 2.0, 2.0], dt=1.0)
    array([2., 3., 3.])
    """

    scales: ClassVar[bool] = True
    at_s: float
    height: Number
