"""Wiener: a linear block, then a static curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from whid.methods.wiener_backlash import WienerBacklash


@dataclass(frozen=True, kw_only=True)
class Wiener(WienerBacklash):
    """A linear block, then a polynomial curve, from sines about zero: `wiener_backlash` with both borders one curve.

    y = f(G·u) + noise. The test for a backlash is made all the same, and what it finds is said. Source [Giri], section 2.

    degree        of the curve
    nonlinearity  static
    whole_record  end with a fit of all numbers to all samples, transients included
    """

    nonlinearity: Literal["auto", "static", "backlash"] = "static"
