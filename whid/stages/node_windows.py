"""The paper's estimate: local lines at the Chebyshev nodes, then the polynomial through their values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._chebyshev import Domain, nodes, scaled, transform, unscaled
from whid.stages._local_lines import Seen, Windows


class NodeWindows(NamedTuple):
    """Node windows: the output at every Chebyshev node by a line through the samples near it, and the polynomial."""

    node: Annotated[Floats, Quantity("input", ("node",))]
    value: Annotated[Floats, Quantity("output", ("node",), error="value_std")]
    value_std: Annotated[Floats, Quantity("output", ("node",))]
    half_width: Annotated[Floats, Quantity("input", ("node",))]
    points: Annotated[NDArray[np.intp], Quantity("1", ("node",))]
    coefficients: Annotated[Floats, Quantity("output", ("order",), error="std")]
    std: Annotated[Floats, Quantity("output", ("order",))]
    covariance: Annotated[Floats, Quantity("output²", ("order", "order"))]
    noise_std: Annotated[float, Quantity("output")]  # about the lines, all windows together
    domain: Annotated[tuple[float, float], Quantity("input")]

    def table(self) -> Table:
        """Return a row a node."""
        rows = tuple(
            (float(f"{x:.6g}"), Measured(float(v), float(s)), float(f"{h:.4g}"), int(n))
            for x, v, s, h, n in zip(self.node, self.value, self.value_std, self.half_width, self.points, strict=True)
        )
        columns = ("node, input", "value, output", "half width, input", "samples")
        return Table("Lines at the Chebyshev nodes", columns, rows, (f"noise std about the lines {self.noise_std:.3g}",))


def node_windows(
    x: Floats, y: Floats, order: int, domain: Domain, half_width: float = 0.002, min_points: int = 15
) -> NodeWindows:
    """Return the polynomial through the values of local least-squares lines at the Chebyshev nodes.

    xᵢ = cos((2i + 1)π/(2K + 2)), (2); over |x − xᵢ| ≤ h: y ≈ g(xᵢ) + s(x − xᵢ); Cⱼ = ξ/(K + 1) Σ g(xᵢ) Tⱼ(xᵢ), (7). h starts
    at half_width and doubles until the window holds min_points samples. x, y (N,), finite; half_width in units of half the
    domain. White noise; its variance is pooled over the lines. Raises `WhidError`: "stage-too-short", "stage-one-sided",
    "stage-rank-one". Source [Jeraj and Mathews], sections 2-4, on [a, b]; how a window grows is our reading.

    >>> x = np.random.default_rng(0).uniform(-1, 1, 20_000)
    >>> node_windows(x, x**3, 3, (-1.0, 1.0)).coefficients.round(4) + 0
    array([0.  , 0.75, 0.  , 0.25])
    """
    return next(each_node_windows(x, [y], order, domain, half_width, min_points))


def each_node_windows(
    x: Floats, outputs: Iterable[Floats], order: int, domain: Domain, half_width: float, min_points: int
) -> Iterator[NodeWindows]:
    """Yield the estimate from every output over the same inputs, whose windows are found once."""
    t = scaled(x, domain)
    seen, halves = Seen.of(t), np.full(order + 1, half_width)
    for windows in Windows.each_filled(t, outputs, nodes(order), halves, min_points):
        yield windows_of(windows, domain, seen, min_points)


def windows_of(windows: Windows, domain: Domain, seen: Seen, min_points: int) -> NodeWindows:
    """Return the estimate of windows that have been filled."""
    order = len(windows.centres) - 1
    found, d = windows.lines(domain, seen, min_points), transform(order)
    value, points = np.array([line.value for line in found]), np.array([line.points for line in found])
    variance = sum(line.rest for line in found) / max(int(points.sum()) - 2 * len(found), 1)
    shared = variance * windows.overlap(found)
    covariance = d @ shared @ d.T
    unit = (domain[1] - domain[0]) / 2
    return NodeWindows(
        unscaled(windows.centres, domain), value, np.sqrt(np.diag(shared)), unit * windows.halves,
        points, d @ value, np.sqrt(np.diag(covariance)), covariance, float(np.sqrt(variance)), domain,
    )  # fmt: skip
