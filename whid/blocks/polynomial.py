"""Polynomial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import MinLen

from whid.blocks._block import Free
from whid.blocks._static import Static
from whid.errors import WhidError
from whid.signal import Floats


@dataclass(frozen=True, kw_only=True)
class Polynomial(Static):
    """A polynomial in its input, coefficients ascending: of powers, or of Chebyshev polynomials.

    power:      w = c₀ + c₁v + c₂v² + … + cₙvⁿ
    chebyshev:  w = c₀ + c₁T₁(t) + … + cₙTₙ(t),  t = (2v − a − b)/(b − a),  T₍ₖ₊₁₎ = 2t·Tₖ − T₍ₖ₋₁₎

          w    │   ╱
          │    ╰──╯
    ──────┼─────────► v
        ╱ │

    coefficients[k] in output/inputᵏ (power) or output (chebyshev), as in `numpy.polynomial`; domain [a, b], input units, is
    what t maps to [−1, 1] (the curve goes on beyond it). No breakpoints. Raises `WhidError("block-parameters")` for a
    domain that does not ascend, or one without the Chebyshev basis. Source [Jeraj and Mathews], eq. (3)-(6).

    >>> Polynomial(coefficients=(-25.0, 0.0, 31.25))([0.0, 1.0, 2.0], dt=1.0)
    array([-25.  ,   6.25, 100.  ])
    >>> Polynomial(coefficients=(0.0, 0.0, 1.0), basis="chebyshev", domain=(0.0, 2.0))([0.0, 1.0, 2.0], dt=1.0)
    array([ 1., -1.,  1.])
    """

    coefficients: Annotated[tuple[Annotated[float, Free("output")], ...], MinLen(1)]
    basis: Literal["power", "chebyshev"] = "power"
    domain: tuple[float, float] | None = None  # left out: [−1, 1]

    def __post_init__(self) -> None:
        if self.domain is not None and self.basis == "power":
            raise WhidError("block-parameters", "a domain belongs to `basis: chebyshev`; powers are those of v itself")
        if self.domain is not None and self.domain[0] >= self.domain[1]:
            raise WhidError("block-parameters", f"domain is [low, high], not {list(self.domain)}")

    def value(self, v: Floats) -> Floats:
        """Return the polynomial."""
        return self._evaluate(v, self.coefficients)

    def derivative(self, v: Floats) -> Floats:
        """Return its derivative."""
        if self.basis == "power":
            return self._evaluate(v, np.polynomial.polynomial.polyder(self.coefficients))
        return self._evaluate(v, np.polynomial.chebyshev.chebder(self.coefficients) / self._half)

    def sensitivity(self, v: Floats, name: str) -> Floats:
        """Return vᵏ or Tₖ(t) for coefficient k."""
        k = int(name.partition(".")[2])
        return np.asarray(v**k) if self.basis == "power" else self._evaluate(v, np.eye(k + 1)[k])

    def sensitivities(self, v: Floats, names: Sequence[str], out: Floats) -> None:
        """Write the powers, or Tₖ(t), each from the one before."""
        t = v if self.basis == "power" else self._scaled(v)
        rows = [np.ones_like(t), t]
        for row, name in zip(out, names, strict=True):
            k = int(name.partition(".")[2])
            while len(rows) <= k:
                rows.append(t * rows[-1] if self.basis == "power" else 2 * t * rows[-1] - rows[-2])
            row[...] = rows[k]

    def like(self, other: Polynomial) -> Polynomial:
        """Return the same curve in the basis of another, padded to its length.

        >>> other = Polynomial(coefficients=(1.0,) * 4, basis="chebyshev")
        >>> Polynomial(coefficients=(0.0, 0.0, 2.0)).like(other).coefficients
        (1.0, 0.0, 1.0, 0.0)
        """
        kinds: dict[str, Any] = {"power": np.polynomial.Polynomial, "chebyshev": np.polynomial.Chebyshev}
        a, b = self._domain if self.basis == "chebyshev" else (-1.0, 1.0)
        c, d = other._domain if other.basis == "chebyshev" else (-1.0, 1.0)
        found = kinds[self.basis](self.coefficients, domain=[a, b]).convert(kind=kinds[other.basis], domain=[c, d]).coef
        found = np.pad(found, (0, max(0, len(other.coefficients) - len(found))))
        return replace(other, coefficients=tuple(map(float, found)))

    @property
    def _domain(self) -> tuple[float, float]:
        return self.domain or (-1.0, 1.0)

    @property
    def _half(self) -> float:
        return (self._domain[1] - self._domain[0]) / 2

    def _evaluate(self, v: Floats, coefficients: Any) -> Floats:
        if self.basis == "power":
            return np.asarray(np.polynomial.polynomial.polyval(v, coefficients))
        return np.asarray(np.polynomial.chebyshev.chebval(self._scaled(v), coefficients))

    def _scaled(self, v: Floats) -> Floats:
        return v if self.domain is None else (v - sum(self._domain) / 2) / self._half
