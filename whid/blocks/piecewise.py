"""Piecewise polynomial with jumps and kinks: the hard nonlinearity of the first paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import MinLen
from numpy.polynomial import polynomial

from whid.blocks._block import Free
from whid.blocks._knee import Knee, bump, checked, edge_rates, edges, flatter, lean, tilt, wider
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats, Ints


@dataclass(frozen=True, kw_only=True)
class Piecewise(Static):
    """A polynomial on each interval between breaks; neighbours may meet (kink) or not (jump).

    w = c₀ + c₁v + c₂v² + …  on [bₖ, bₖ₊₁), coefficients ascending, one list an interval.

          w       ╱
          │  ●   ╱        ● belongs to the piece on its right
          │ ╱    │
    ──────●──────○──► v
         b₁      b₂

    breaks (S,) ascending, input units; pieces S + 1 lists, coefficient k in output/inputᵏ. knee: every kink is rounded, and
    every jump climbs, over that width (input units); left out: hard. Raises `WhidError("block-parameters")` for breaks that
    do not ascend, a wrong number of pieces or knee < 0. Source [Brouri2019], Remark 3.2, eq. (3.15).

    >>> Piecewise(breaks=(0.0,), pieces=((0.0,), (1.0, 2.0)))([-1.0, 0.0, 3.0], dt=1.0)
    array([0., 1., 7.])
    >>> Piecewise(breaks=(0.0,), pieces=((0.0,), (1.0, 2.0)), knee=0.8)([-1.0, 0.0, 3.0], dt=1.0)
    array([0. , 0.7, 7. ])
    """

    breaks: tuple[Annotated[float, Free("input")], ...]
    pieces: Annotated[tuple[tuple[Annotated[float, Free("output")], ...], ...], MinLen(1)]
    knee: Knee = None

    def __post_init__(self) -> None:
        if len(self.pieces) != len(self.breaks) + 1:
            raise WhidError(
                "block-parameters", f"{len(self.breaks)} breaks make {len(self.breaks) + 1} pieces, not {len(self.pieces)}"
            )
        if any(b >= a for b, a in zip(self.breaks, self.breaks[1:], strict=False)):
            raise WhidError("block-parameters", f"breaks must ascend: {list(self.breaks)}")
        checked(self.knee)

    def value(self, v: Floats) -> Floats:
        """Return the polynomial of the piece that v lies in, rounded near the breaks."""
        hard = self._evaluate(v, [np.asarray(c) for c in self.pieces])
        return hard + sum(f.jump * lean(v - f.at, self.knee) + f.rise(v) * bump(v - f.at, self.knee) for f in self._folds)

    def derivative(self, v: Floats) -> Floats:
        """Return the derivative of the piece that v lies in, and of the rounding."""
        slope = self._evaluate(v, [np.asarray(polynomial.polyder(c)) for c in self.pieces])
        for f in self._folds:
            x = v - f.at
            slope += f.jump * tilt(x, self.knee) + f.slope(v) * bump(x, self.knee) + f.rise(v) * lean(x, self.knee)
        return slope

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return vᵏ on the coefficient's own piece; a break moves no value unless it is rounded (see `break_rates`)."""
        head, *place = name.split(".")
        if head == "knee":
            parts = [f.jump * flatter(v - f.at, self.knee) + f.rise(v) * wider(v - f.at, self.knee) for f in self._folds]
            return np.asarray(sum(parts, np.zeros_like(v)))
        if head == "breaks":
            return self._moved(v, int(place[0]))
        piece, power = int(place[0]), int(place[1])
        own = np.where(self._piece(v) == piece, v**power, 0.0)
        for k, sign in ((piece - 1, 1.0), (piece, -1.0)):
            if self.knee and 0 <= k < len(self.breaks):
                f, x = _fold(self.breaks[k], np.eye(power + 1)[power]), v - self.breaks[k]
                own += sign * (f.jump * lean(x, self.knee) + f.rise(v) * bump(x, self.knee))
        return own

    def sensitivities(self, v: Floats, names: Sequence[str], out: Floats) -> None:
        """Write all rows with the pieces looked up once, where no knee rounds them."""
        if self.knee is not None:
            return super().sensitivities(v, names, out)
        piece = self._piece(v)
        inside = {j: piece == j for j in {int(n.split(".")[1]) for n in names if n.startswith("pieces")}}
        powers: list[Floats] = [np.ones_like(v)]
        for row, name in zip(out, names, strict=True):
            head, *place = name.split(".")
            if head == "breaks":
                row[...] = 0.0
                continue
            while len(powers) <= int(place[1]):
                powers.append(powers[-1] * v)
            np.multiply(inside[int(place[0])], powers[int(place[1])], out=row)

    def few(self, v: Floats, names: Sequence[str]) -> tuple[Ints, Floats] | None:
        """Return the powers on the piece that each panel lies on, unless knees round the breaks."""
        if self.knee is not None:
            return None
        degree = max(len(c) for c in self.pieces)
        row_of = np.full((degree, len(self.pieces)), -1)
        for row, name in enumerate(names):
            head, *at = name.split(".")
            if head == "pieces":
                row_of[int(at[1]), int(at[0])] = row
        return row_of[:, self._piece(v[len(v) // 2])], v ** np.arange(degree)[:, None, None]

    def breakpoints(self) -> Floats:
        """Return the breaks, or where their knees begin and end."""
        return edges(np.array(self.breaks, float), self.knee)

    def break_rates(self, name: str) -> Floats:
        """Return how the breakpoints move."""
        rates = np.array([name == f"breaks.{k}" for k in range(len(self.breaks))], float)
        return edge_rates(np.array(self.breaks, float), rates, self.knee, widening=name == "knee")

    def jumps(self) -> Floats:
        """Return the difference of the two pieces at every break, none where it is rounded."""
        return np.zeros(2 * len(self.breaks)) if self.knee else self._steps()

    def kinks(self) -> np.ndarray:
        """Return which breaks are kinks: the pieces beside them meet, to rounding.

        >>> Piecewise(breaks=(0.0, 1.0), pieces=((0.0,), (0.0, 2.0), (3.0,))).kinks()
        array([ True, False])
        """
        value = polynomial.polyval
        size = max([1e-300, *(abs(float(value(b, c))) for b in self.breaks for c in self.pieces)])
        return np.asarray(np.abs(self._steps()) <= 1e-9 * size)

    def _steps(self) -> Floats:
        pairs = zip(self.breaks, self.pieces[1:], self.pieces[:-1], strict=True)
        return np.array([polynomial.polyval(b, right) - polynomial.polyval(b, left) for b, right, left in pairs])

    @property
    def _folds(self) -> list[_Fold]:
        """Return what the curve does at every break; nothing where it is hard."""
        if not self.knee:
            return []
        pairs = zip(self.breaks, self.pieces[1:], self.pieces[:-1], strict=True)
        return [_fold(b, np.asarray(polynomial.polysub(right, left), float)) for b, right, left in pairs]

    def _moved(self, v: Floats, k: int) -> Floats:
        """Return the derivative of the rounding with respect to its break."""
        if not self.knee:
            return np.zeros_like(v)
        f, x = self._folds[k], v - self.breaks[k]
        turned = f.rise(np.array(f.at)) * lean(x, self.knee) + f.turning(v) * bump(x, self.knee)
        return np.asarray(turned - f.jump * tilt(x, self.knee) - f.rise(v) * lean(x, self.knee))

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


class _Fold(NamedTuple):
    """The right piece less the left one at a break: jump + (v − at)·rise(v)."""

    at: float
    jump: float
    quotient: Floats  # rise, ascending
    quotient_rate: Floats  # its derivative with respect to `at`

    def rise(self, v: Floats) -> Floats:
        return np.asarray(polynomial.polyval(v, self.quotient))

    def slope(self, v: Floats) -> Floats:
        return np.asarray(polynomial.polyval(v, polynomial.polyder(self.quotient)))

    def turning(self, v: Floats) -> Floats:
        return np.asarray(polynomial.polyval(v, self.quotient_rate))


def _fold(at: float, difference: Floats) -> _Fold:
    """Divide a polynomial by (v − at): quotient coefficient i is Σ c_m·at^(m−1−i) over m > i.

    >>> _fold(2.0, np.array([1.0, 0.0, 3.0]))
    _Fold(at=2.0, jump=13.0, quotient=array([6., 3.]), quotient_rate=array([3., 0.]))
    """
    i, m = np.ogrid[: max(len(difference) - 1, 1), : len(difference)]
    power = m - 1 - i
    quotient = np.where(power >= 0, float(at) ** np.maximum(power, 0), 0.0) @ difference
    rate = np.where(power >= 1, power * float(at) ** np.maximum(power - 1, 0), 0.0) @ difference
    return _Fold(at, float(polynomial.polyval(at, difference)), quotient, rate)
