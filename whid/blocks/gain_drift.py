"""A gain that drifts in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import MinLen

from whid.blocks._block import Number
from whid.blocks._clocked import Clocked
from whid.blocks.spline import Spline
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class GainDrift(Clocked):
    """The signal times a smooth course in time around 1: a sensor whose sensitivity moves.

    w(t) = v(t)·(1 + s(t)),  s(times[k]) = levels[k], a natural cubic spline, straight beyond

             1 + s
              │
    v ──────►(×)──► w

    times in s, ascending, the record's own; levels relative. Two points are a ramp. Raises
    `WhidError("block-parameters")` for unequal lengths or times that do not ascend.

    >>> GainDrift(times=(0.0, 2.0), levels=(0.0, 0.1))([5.0, 5.0, 5.0], dt=1.0)
    array([5.  , 5.25, 5.5 ])
    """

    scales: ClassVar[bool] = True
    times: Annotated[tuple[float, ...], MinLen(2)]
    levels: Annotated[tuple[Number, ...], MinLen(2)]

    def __post_init__(self) -> None:
        self._spline  # noqa: B018 (it checks)

    @property
    def _spline(self) -> Spline:
        return Spline(inputs=self.times, outputs=self.levels)

    def at(self, time: Floats, wrt: str = "") -> Floats:
        """Return the relative change, or its derivative with respect to one level."""
        return self._spline.sensitivity(time, wrt) if wrt else self._spline.value(time)
