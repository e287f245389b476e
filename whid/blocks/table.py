"""Table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import MinLen

from whid.blocks._block import Free
from whid.blocks._knee import Knee, bump, checked, edge_rates, edges, lean, wider
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats, Ints


@dataclass(frozen=True, kw_only=True)
class Table(Static):
    """Straight lines through given points: a measured characteristic.

    w = outputs[k] + (outputs[k+1] − outputs[k])·(v − inputs[k])/(inputs[k+1] − inputs[k]) on [inputs[k], inputs[k+1]]

          w    ●───●
          │   ╱
    ──────┼──●───────► v
       ●──╯

    Beyond the ends the last line goes on (`beyond: extrapolate`) or the last point is held (`hold`). inputs ascending,
    at least two. knee: every corner is rounded by a parabola that wide (input units), left out: sharp. Raises
    `WhidError("block-parameters")` for unequal lengths, inputs that do not ascend or knee < 0.

    >>> Table(inputs=(0.0, 1.0, 3.0), outputs=(0.0, 2.0, 3.0), beyond="hold")([0.5, 2.0, 9.0], dt=1.0)
    array([1. , 2.5, 3. ])
    """

    inputs: Annotated[tuple[Annotated[float, Free("input")], ...], MinLen(2)]
    outputs: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(2)]
    beyond: Literal["extrapolate", "hold"] = "extrapolate"
    knee: Knee = None

    def __post_init__(self) -> None:
        if len(self.inputs) != len(self.outputs) or len(self.inputs) < 2:
            raise WhidError(
                "block-parameters",
                f"table needs as many outputs as inputs, two or more: {len(self.inputs)}, {len(self.outputs)}",
            )
        if any(b >= a for b, a in zip(self.inputs, self.inputs[1:], strict=False)):
            raise WhidError("block-parameters", f"table inputs must ascend: {list(self.inputs)}")
        checked(self.knee)

    def value(self, v: Floats) -> Floats:
        """Return the interpolated output."""
        return self._rounded(self._line(*self._cell(v)), v, self._bends(), bump)

    def on_pieces(self, v: Floats) -> Floats:
        """Return the interpolated output, the line looked up at each panel's middle."""
        return self.value(v) if self.knee is not None else self._line(*self._piece(v))

    def derivative(self, v: Floats) -> Floats:
        """Return the slope of the line that v lies on."""
        k, x = self._cell(v)
        return self._rounded(np.where(x == v, np.take(self._slopes(), k), 0.0), v, self._bends(), lean)

    def derivative_on_pieces(self, v: Floats) -> Floats:
        """Return the slope of the line that each panel lies on."""
        if self.knee is not None:
            return self.derivative(v)
        k, x = self._piece(v)
        slope = np.broadcast_to(np.take(self._slopes(), k), v.shape)
        return slope if x is v else np.where(x == v, slope, 0.0)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the hat function of the point; moving it sideways is moving it down the lines beside it."""
        head, _, place = name.partition(".")
        if head == "knee":
            return self._rounded(np.zeros_like(v), v, self._bends(), wider)
        k, x = self._cell(v)
        hat = np.eye(len(self.inputs))[int(place)]
        share = (x - np.take(self.inputs, k)) / np.take(np.diff(self.inputs), k)
        height = np.take(hat, k) * (1 - share) + np.take(hat, k + 1) * share
        if head == "outputs":
            return self._rounded(height, v, self._change(np.diff(hat) / np.diff(self.inputs)), bump)
        moved = np.where(x == v, -np.take(self._slopes(), k) * height, 0.0)
        turned = self._change(-self._slopes() * np.diff(hat) / np.diff(self.inputs))
        return self._rounded(self._rounded(moved, v, turned, bump), v, -hat * self._bends(), lean)

    def sensitivities(self, v: Floats, names: Sequence[str], out: Floats) -> None:
        """Write the hats: every v lies on two of them only, unless knees round them."""
        if self.knee is not None:
            return super().sensitivities(v, names, out)
        k, x = self._cell(v)
        share = (x - np.take(self.inputs, k)) / np.take(np.diff(self.inputs), k)
        sideways = np.where(x == v, -np.take(self._slopes(), k), 0.0)
        out[...] = 0.0
        flat, place = out.reshape(-1), np.arange(v.size)
        for head in ("outputs", "inputs"):
            mine = {int(name.partition(".")[2]): row for row, name in enumerate(names) if name.startswith(head)}
            row_of = np.array([mine.get(point, -1) for point in range(len(self.inputs))])
            for point, height in ((k, 1 - share), (k + 1, share)):
                row, here = row_of[point].ravel(), (height if head == "outputs" else height * sideways).ravel()
                hit = slice(None) if row.min(initial=0) >= 0 else np.flatnonzero(row >= 0)
                flat[row[hit] * v.size + place[hit]] = here[hit]

    def few(self, v: Floats, names: Sequence[str]) -> tuple[Ints, Floats] | None:
        """Return the hats of the two points that each panel lies between, unless knees round them."""
        if self.knee is not None:
            return None
        k, x = self._piece(v)
        share = (x - np.take(self.inputs, k)) / np.take(np.diff(self.inputs), k)
        heads = [head for head in ("outputs", "inputs") if any(name.startswith(head) for name in names)]
        sideways = np.where(x == v, -np.take(self._slopes(), k), 0.0)
        place, values = [], []
        for head in heads:
            mine = {int(name.partition(".")[2]): row for row, name in enumerate(names) if name.startswith(head)}
            row_of = np.array([mine.get(point, -1) for point in range(len(self.inputs))])
            place += [row_of[k], row_of[k + 1]]
            values += [h if head == "outputs" else h * sideways for h in (1 - share, share)]
        return np.array(place), np.array(values)

    def breakpoints(self) -> Floats:
        """Return the points where the slope changes, or where their knees begin and end."""
        return edges(self._corners(), self.knee)

    def break_rates(self, name: str) -> Floats:
        """Return how the breakpoints move."""
        rates = np.array([name == f"inputs.{k}" for k in range(len(self.inputs))], float)
        rates = rates if self.beyond == "hold" else rates[1:-1]
        return edge_rates(self._corners(), rates, self.knee, widening=name == "knee")

    def _corners(self) -> Floats:
        """Return the points where the slope changes: the ends only where the output is held beyond them."""
        return np.array(self.inputs if self.beyond == "hold" else self.inputs[1:-1], float)

    def _bends(self) -> Floats:
        return self._change(self._slopes())

    def _change(self, slopes: Floats) -> Floats:
        """Return the change of slope at every point, 0 at the ends where the lines go on."""
        ends = (0.0, 0.0) if self.beyond == "hold" else (slopes[0], slopes[-1])
        return np.diff(np.concatenate([ends[:1], slopes, ends[1:]]))

    def _rounded(self, sharp: Floats, v: Floats, bends: Floats, shape: Callable[[Floats, float | None], Floats]) -> Floats:
        for at, bend in zip(self.inputs, bends, strict=True) if self.knee else ():
            if bend:
                sharp = sharp + bend * shape(v - at, self.knee)
        return sharp

    def _slopes(self) -> Floats:
        return np.asarray(np.diff(self.outputs) / np.diff(self.inputs), np.float64)

    def _cell(self, v: Floats) -> tuple[Ints, Floats]:
        """Return the line that v lies on, and v, held within the table where it is."""
        return np.searchsorted(self.inputs[1:-1], v, side="right"), self._within(v)

    def _piece(self, v: Floats) -> tuple[Ints, Floats]:
        """Return the line that each panel (q, n) lies on, and v, held within the table where it is."""
        return self._cell(v[len(v) // 2])[0], self._within(v)

    def _line(self, k: Ints, x: Floats) -> Floats:
        return np.asarray(np.take(self.outputs, k) + np.take(self._slopes(), k) * (x - np.take(self.inputs, k)))

    def _within(self, v: Floats) -> Floats:
        return np.asarray(np.clip(v, self.inputs[0], self.inputs[-1]) if self.beyond == "hold" else v)
