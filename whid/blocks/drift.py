"""A slow drift, added to what comes in: a sensor whose zero moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import MinLen

from whid.blocks._block import Free
from whid.blocks._clocked import Clocked
from whid.blocks.spline import Spline
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Drift(Clocked):
    """The same signal plus a smooth course in time, a natural cubic spline through points; straight beyond them.

    w(t) = v(t) + s(t),  s(times[k]) = levels[k]

              ╭─╮ s
            ──╯ ╰─
              │
    v ──────►(+)──► w

    times in s, ascending, the record's own (they stay as they are in a fit); levels in output units. Two points are a ramp.
    Raises `WhidError("block-parameters")` for unequal lengths or times that do not ascend.

    >>> Drift(times=(0.0, 2.0), levels=(0.0, 1.0))([5.0, 5.0, 5.0], dt=1.0)
    array([5. , 5.5, 6. ])
    """

    times: Annotated[tuple[float, ...], MinLen(2)]
    levels: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(2)]

    def __post_init__(self) -> None:
        self._spline  # noqa: B018 (it checks)

    @property
    def _spline(self) -> Spline:
        return Spline(inputs=self.times, outputs=self.levels)

    def at(self, time: Floats, wrt: str = "") -> Floats:
        """Return the drift, or its derivative with respect to one level."""
        return self._spline.sensitivity(time, wrt) if wrt else self._spline.value(time)
