"""Piecewise polynomial with jumps and kinks: the hard nonlinearity of the first paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import MinLen

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Piecewise(Static):
    """A polynomial on each interval between breaks; neighbours may meet (kink) or not (jump).

    w = c₀ + c₁v + c₂v² + …  on [bₖ, bₖ₊₁), coefficients ascending, one list an interval.

          w       ╱
          │  ●   ╱        ● belongs to the piece on its right
          │ ╱    │
    ──────●──────○──► v
         b₁      b₂

    breaks (S,) ascending, input units; pieces S + 1 lists, coefficient k in output/inputᵏ. Raises
    `WhidError("block-parameters")` for breaks that do not ascend or a wrong number of pieces.
    Source [Brouri2019], Remark 3.2, eq. (3.15).

    >>> Piecewise(breaks=(0.0,), pieces=((0.0,), (1.0, 2.0)))([-1.0, 0.0, 3.0], dt=1.0)
    array([0., 1., 7.])
    """

    breaks: tuple[Annotated[float, Free("input")], ...]
    pieces: Annotated[tuple[tuple[Annotated[float, Free("output")], ...], ...], MinLen(1)]

    def __post_init__(self) -> None:
        if len(self.pieces) != len(self.breaks) + 1:
            raise WhidError(
                "block-parameters", f"{len(self.breaks)} breaks make {len(self.breaks) + 1} pieces, not {len(self.pieces)}"
            )
        if any(b >= a for b, a in zip(self.breaks, self.breaks[1:], strict=False)):
            raise WhidError("block-parameters", f"breaks must ascend: {list(self.breaks)}")

    def value(self, v: Floats) -> Floats:
        """Return the polynomial of the piece that v lies in."""
        return self._evaluate(v, [np.asarray(c) for c in self.pieces])

    def derivative(self, v: Floats) -> Floats:
        """Return the derivative of the piece that v lies in."""
        return self._evaluate(v, [np.asarray(np.polynomial.polynomial.polyder(c)) for c in self.pieces])

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return vᵏ on the coefficient's own piece; a break moves no value (see `break_rates`)."""
        head, *place = name.split(".")
        if head == "breaks":
            return np.zeros_like(v)
        piece, power = int(place[0]), int(place[1])
        return np.where(self._piece(v) == piece, v**power, 0.0)

    def breakpoints(self) -> Floats:
        """Return the breaks."""
        return np.array(self.breaks, float)

    def break_rates(self, name: str) -> Floats:
        """Return 1 for the break itself."""
        return np.array([name == f"breaks.{k}" for k in range(len(self.breaks))], float)

    def jumps(self) -> Floats:
        """Return the difference of the two pieces at every break."""
        value = np.polynomial.polynomial.polyval
        pairs = zip(self.breaks, self.pieces[1:], self.pieces[:-1], strict=True)
        return np.array([value(b, right) - value(b, left) for b, right, left in pairs])

    def kinks(self) -> np.ndarray:
        """Return which breaks are kinks: the pieces beside them meet, to rounding.

        >>> Piecewise(breaks=(0.0, 1.0), pieces=((0.0,), (0.0, 2.0), (3.0,))).kinks()
        array([ True, False])
        """
        value = np.polynomial.polynomial.polyval
        size = max([1e-300, *(abs(float(value(b, c))) for b in self.breaks for c in self.pieces)])
        return np.asarray(np.abs(self.jumps()) <= 1e-9 * size)

    def _piece(self, v: Floats) -> np.ndarray:
        piece = np.zeros(np.shape(v), np.int8 if len(self.breaks) < 127 else np.int32)
        for b in self.breaks:  # a comparison a break is ten times faster than searchsorted for a handful
            piece += v >= b
        return piece

    def _evaluate(self, v: Floats, coefficients: list[Floats]) -> Floats:
        degree = max(len(c) for c in coefficients)
        table = np.zeros((degree, len(coefficients)))
        for j, c in enumerate(coefficients):
            table[: len(c), j] = c
        piece = self._piece(v)
        result = table[-1].take(piece)
        for row in table[-2::-1]:
            result *= v
            result += row.take(piece)
        return np.asarray(result)
