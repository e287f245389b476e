"""Nodes on what a pilot leaves over: the minimax property of the nodes at nearly the variance of least squares."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Quantity
from whid.signal import Floats
from whid.stages._chebyshev import basis, nodes, scaled, transform
from whid.stages._local_lines import lines, overlap
from whid.stages.chebyshev_fit import ChebyshevFit

ITERATIONS = 4
MIN_POINTS = 15


class NodePlus(NamedTuple):
    """Node-plus: the polynomial through the curve at the Chebyshev nodes, lines fitted to what a pilot leaves over."""

    coefficients: Annotated[Floats, Quantity("output", ("order",), error="std")]
    std: Annotated[Floats, Quantity("output", ("order",))]
    covariance: Annotated[Floats, Quantity("output²", ("order", "order"))]
    iterations: int


def node_plus(x: Floats, y: Floats, pilot: ChebyshevFit, min_points: int = MIN_POINTS) -> NodePlus:
    """Return the polynomial that meets, at every node, the pilot plus a line through its residual there.

    c ← c + D·L(y − p_c): L gives the lines' values at the nodes, D is (7). The residual is small and nearly straight where y
    itself is not, so that a window may reach half-way to its neighbours, half-width ½ sin θᵢ·π/(K + 1), and there is no
    floor at infinite SNR; 4 rounds at most. A window at an end of the domain reaches beyond it, where there are samples.
    x, y (N,), finite. The covariance is that of the whole linear map of y, the pilot's part included, for the noise that
    the pilot's wider fit finds. Raises as `node_windows` does.

    >>> from whid.stages.chebyshev_fit import chebyshev_fit
    >>> x = np.random.default_rng(0).uniform(-1, 1, 20_000)
    >>> node_plus(x, x**3, chebyshev_fit(x, x**3, 3, (-1.0, 1.0))).coefficients.round(12) + 0
    array([0.  , 0.75, 0.  , 0.25])
    """
    order = len(pilot.coefficients) - 1
    t, centres, d = scaled(x, pilot.domain), nodes(order), transform(order)
    widths = 0.5 * np.sqrt(1 - centres**2) * np.pi / (order + 1)
    found = lines(t, centres, list(map(float, widths)), min_points, pilot.domain)
    rows = [basis(t[line.where], order) for line in found]
    design = np.array([row @ line.at_node for row, line in zip(rows, found, strict=True)])  # L·T
    inside = [line.at_node * (np.abs(t[line.where]) <= 1) for line in found]  # what the pilot saw as well
    common = np.array([row @ weight for row, weight in zip(rows, inside, strict=True)])
    seen = np.array([line.at_node @ y[line.where] for line in found])  # L·y
    one, c = np.eye(order + 1), pilot.coefficients
    from_lines, from_pilot = np.zeros_like(d), one  # c = from_lines · L y + from_pilot · pilot
    tolerance = 1e-3 * pilot.bound + 1e-15 * np.abs(c).max()
    done = 0
    while done < ITERATIONS:
        done += 1
        step = d @ (seen - design @ c)
        c, kept = c + step, one - d @ design
        from_lines, from_pilot = kept @ from_lines + d, kept @ from_pilot
        if np.all(np.abs(step) <= tolerance):
            break
    both = from_lines @ common @ pilot.inverse_gram @ from_pilot.T
    spread = from_lines @ overlap(found, len(t)) @ from_lines.T + from_pilot @ pilot.inverse_gram @ from_pilot.T
    covariance = pilot.noise_std**2 * (spread + both + both.T)
    return NodePlus(c, np.sqrt(np.diag(covariance)), covariance, done)
