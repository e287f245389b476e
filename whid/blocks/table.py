"""Table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import MinLen

from whid.blocks._block import Free
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
    at least two. Raises `WhidError("block-parameters")` for unequal lengths or inputs that do not ascend.

    >>> Table(inputs=(0.0, 1.0, 3.0), outputs=(0.0, 2.0, 3.0), beyond="hold")([0.5, 2.0, 9.0], dt=1.0)
    array([1. , 2.5, 3. ])
    """

    inputs: Annotated[tuple[Annotated[float, Free("input")], ...], MinLen(2)]
    outputs: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(2)]
    beyond: Literal["extrapolate", "hold"] = "extrapolate"

    def __post_init__(self) -> None:
        if len(self.inputs) != len(self.outputs) or len(self.inputs) < 2:
            raise WhidError(
                "block-parameters",
                f"table needs as many outputs as inputs, two or more: {len(self.inputs)}, {len(self.outputs)}",
            )
        if any(b >= a for b, a in zip(self.inputs, self.inputs[1:], strict=False)):
            raise WhidError("block-parameters", f"table inputs must ascend: {list(self.inputs)}")

    def value(self, v: Floats) -> Floats:
        """Return the interpolated output."""
        k, x = self._cell(v)
        return np.asarray(np.take(self.outputs, k) + np.take(self._slopes(), k) * (x - np.take(self.inputs, k)))

    def derivative(self, v: Floats) -> Floats:
        """Return the slope of the line that v lies on."""
        k, x = self._cell(v)
        return np.where(x == v, np.take(self._slopes(), k), 0.0)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return the hat function of the point; moving it sideways is moving it down the lines beside it."""
        head, _, place = name.partition(".")
        k, x = self._cell(v)
        hat = np.eye(len(self.inputs))[int(place)]
        share = (x - np.take(self.inputs, k)) / np.take(np.diff(self.inputs), k)
        height = np.take(hat, k) * (1 - share) + np.take(hat, k + 1) * share
        return np.asarray(height if head == "outputs" else np.where(x == v, -np.take(self._slopes(), k) * height, 0.0))

    def breakpoints(self) -> Floats:
        """Return the points where the slope changes: the ends only where the output is held beyond them."""
        return np.array(self.inputs if self.beyond == "hold" else self.inputs[1:-1], float)

    def break_rates(self, name: str) -> Floats:
        """Return 1 for the point itself."""
        rates = np.array([name == f"inputs.{k}" for k in range(len(self.inputs))], float)
        return rates if self.beyond == "hold" else rates[1:-1]

    def _slopes(self) -> Floats:
        return np.asarray(np.diff(self.outputs) / np.diff(self.inputs), np.float64)

    def _cell(self, v: Floats) -> tuple[Ints, Floats]:
        """Return the line that v lies on, and v, held within the table where it is."""
        k = np.searchsorted(self.inputs[1:-1], v, side="right")
        return k, np.asarray(np.clip(v, self.inputs[0], self.inputs[-1]) if self.beyond == "hold" else v)
