"""The estimates of a memoryless curve side by side, and which of them is reported."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, cast

import numpy as np

from whid.quantity import Cell, Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._chebyshev import Domain
from whid.stages.chebyshev_fit import ChebyshevFit
from whid.stages.lack_of_fit import LackOfFit
from whid.stages.node_plus import NodePlus
from whid.stages.node_windows import NodeWindows

Choice = Literal["auto", "least_squares", "node_plus", "node_windows"]
WORDS = {"node_windows": "as in the paper", "node_plus": "node-plus", "least_squares": "least squares"}


class CurveEstimates(NamedTuple):
    """Chebyshev coefficients: as in the paper, by node-plus, by least squares, and the bound of an unbiased estimate."""

    order: Annotated[Floats, Quantity("1", ("order",))]
    node_windows: Annotated[Floats, Quantity("output", ("order",), error="node_windows_std")]
    node_windows_std: Annotated[Floats, Quantity("output", ("order",))]
    node_plus: Annotated[Floats, Quantity("output", ("order",), error="node_plus_std")]
    node_plus_std: Annotated[Floats, Quantity("output", ("order",))]
    least_squares: Annotated[Floats, Quantity("output", ("order",), error="least_squares_std")]
    least_squares_std: Annotated[Floats, Quantity("output", ("order",))]
    bound: Annotated[Floats, Quantity("output", ("order",))]  # Cramér-Rao, of the standard error, at the noise found
    reported: str
    covariance: Annotated[Floats, Quantity("output²", ("order", "order"))]  # of the reported one
    noise_std: Annotated[float, Quantity("output")]
    domain: Annotated[tuple[float, float], Quantity("input")]
    samples: int
    outside: int

    @property
    def coefficients(self) -> Floats:
        """Return the reported ones."""
        return np.asarray(getattr(self, self.reported))

    def table(self) -> Table:
        """Return a row a coefficient, without the estimates that were not made."""
        made = [name for name in WORDS if np.isfinite(getattr(self, name)).all()]
        rows = tuple(
            cast("tuple[Cell, ...]", (f"C{j}", *(self._cell(name, j) for name in made), float(f"{self.bound[j]:.3g}")))
            for j in self._orders
        )
        low, high = self.domain
        notes = (
            f"reported: {WORDS[self.reported]}; {self.samples} samples in the domain [{low:.6g}, {high:.6g}]"
            + (f", {self.outside} outside it not used" if self.outside else ""),
            f"the bound is Cramér and Rao's, of a standard error, for white noise of std {self.noise_std:.3g}",
        )
        return Table("Chebyshev coefficients", ("coefficient", *(WORDS[name] for name in made), "bound"), rows, notes)

    def metrics(self) -> dict[str, float | Measured]:
        """Return C0, C1, … as reported, and as in the paper."""
        found: dict[str, float | Measured] = {f"C{j}": self._cell(self.reported, j) for j in self._orders}
        if np.isfinite(self.node_windows).all():
            found |= {f"paper.C{j}": self._cell("node_windows", j) for j in self._orders}
        return found

    @property
    def _orders(self) -> range:
        return range(len(self.bound))

    def _cell(self, name: str, j: int) -> Measured:
        return Measured(float(getattr(self, name)[j]), float(getattr(self, f"{name}_std")[j]))


def curve_estimates(
    windows: NodeWindows | None, plus: NodePlus | None, fit: ChebyshevFit, verdict: LackOfFit, choice: Choice, domain: Domain
) -> CurveEstimates:
    """Return all estimates and which to report; auto: least squares, node-plus where the order is too low."""
    reported = choice if choice != "auto" else "least_squares" if verdict.passed else "node_plus"
    absent = np.full(len(fit.coefficients), np.nan)
    covariances = {
        "least_squares": fit.estimate.covariance,
        "node_plus": plus.covariance if plus else None,
        "node_windows": windows.covariance if windows else None,
    }
    covariance = covariances[reported]
    assert covariance is not None
    return CurveEstimates(
        order=np.arange(len(absent), dtype=float),
        node_windows=windows.coefficients if windows else absent,
        node_windows_std=windows.std if windows else absent,
        node_plus=plus.coefficients if plus else absent,
        node_plus_std=plus.std if plus else absent,
        least_squares=fit.coefficients,
        least_squares_std=fit.estimate.std,
        bound=fit.bound,
        reported=reported,
        covariance=covariance,
        noise_std=fit.noise_std,
        domain=domain,
        samples=fit.samples,
        outside=fit.outside,
    )
