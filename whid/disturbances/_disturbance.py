"""What every disturbance is: a place and a draw."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge

from whid.errors import WhidError
from whid.kinds import Kind
from whid.signal import Floats

Place = Literal["output", "nonlinearity"]


@dataclass(frozen=True, kw_only=True)
class Disturbance(Kind):
    """Something added to the signal: at the output, or ahead of the first nonlinear block of the chain.

    Its size is `std` (units of the signal) or `snr_db` = 10 log₁₀(var x / std²), x the undisturbed output of the
    record, mean removed. Raises `WhidError("disturbance-size")` unless exactly one of the two is given.
    """

    family: ClassVar[str] = "whid.disturbances"
    place: ClassVar[Place] = "output"
    std: Annotated[float, Ge(0)] | None = None
    snr_db: float | None = None

    def __post_init__(self) -> None:
        if (self.std is None) == (self.snr_db is None):
            raise WhidError("disturbance-size", f"{self.kind} needs exactly one of std, snr_db")

    def stream(self, samples: int, dt: float, rng: np.random.Generator) -> Callable[[int], Floats] | None:
        """Return a function that draws the next n of so many samples, the numbers of `draw`; None: only all at once."""
        return None

    @abstractmethod
    def draw(self, samples: int, dt: float, rng: np.random.Generator) -> Floats:
        """Return a draw of unit standard deviation, (samples,)."""

    @abstractmethod
    def covariance(self, lags: int, dt: float) -> Floats:
        """Return the autocovariance at lags 0 … lags − 1 for unit standard deviation."""

    def shape(self, undisturbed: Floats, dt: float) -> Floats | float:
        """Return by how much more or less it is at every sample: 1, unless its size follows the signal."""
        return 1.0

    def scale(self, undisturbed: Floats) -> float:
        """Return the standard deviation, from `std` or from the record's variance and `snr_db`."""
        if self.std is not None:
            return self.std
        return float(np.std(undisturbed) * 10 ** (-(self.snr_db or 0.0) / 20))
