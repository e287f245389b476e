"""An offset that comes at a moment and stays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from whid.blocks._block import Free
from whid.blocks._clocked import Switched


@dataclass(frozen=True, kw_only=True)
class OffsetStep(Switched):
    """The same signal, higher from a moment on: a sensor that was knocked.

    w(t) = v(t) + height for t ≥ at_s, v(t) before; at_s in s, the record's own time, height in output units

            ┌── height
         ───┘ at_s
            │
    v ────►(+)──► w

    >>> OffsetStep(at_s=1.0, height=0.5)([2.0, 2.0, 2.0], dt=1.0)
    array([2. , 2.5, 2.5])
    """

    at_s: float
    height: Annotated[float, Free("output")]
