"""The data that the sine stages share: harmonics of the output for every sine, and f on the levels it covers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Measured

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


class Responses(NamedTuple):
    """Harmonics of y for each of E sines: y = Re Σ_k value_k e^{jkωt}, time from the start of the sine."""

    omega: Floats  # (E,) rad/s
    offset: Floats  # (E,) input units
    phasor: Complexes  # (E,) of the continuous input that acts on the plant
    value: Complexes  # (E, K + 1)
    value_std: Floats  # (E, K + 1) of the real part and of the imaginary part
    orders: tuple[tuple[int, ...], ...]  # harmonics of each sine that take part, 0 included


class StaticPart(NamedTuple):
    """The nonlinearity where the sines run: start values and the levels measured there."""

    level: Floats  # (L,)
    mean: Floats  # (L,)
    mean_std: Floats  # (L,)
    breaks: Floats  # (S,)
    coefficients: Floats  # (S + 1, d + 1), zero-padded, ascending
    degrees: tuple[int, ...]  # (S + 1,)
    kinks: tuple[int, ...] = ()  # the breaks at which the pieces meet


def response_metrics(prefix: str, result: object) -> dict[str, Measured]:
    """Return gains and phases of a result with the fields front_gain, back_phase_std, …, by name."""
    found = {}
    for block in ("front", "back"):
        omegas = getattr(result, f"{block}_omega")
        for quantity in ("gain", "phase"):
            values, errors = getattr(result, f"{block}_{quantity}"), getattr(result, f"{block}_{quantity}_std")
            for w, value, error in zip(omegas, values, errors, strict=True):
                found[f"{prefix}.{block}.{quantity}@{w:.6g}"] = Measured(float(value), float(error))
    return found
