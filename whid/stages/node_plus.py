"""Nodes on what a pilot leaves over: the minimax property of the nodes at nearly the variance of least squares."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Quantity
from whid.signal import Floats
from whid.stages._chebyshev import nodes, scaled, transform
from whid.stages._local_lines import Seen, Windows
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
    order, domain = len(pilot.coefficients) - 1, pilot.domain
    t = scaled(x, domain)
    windows = Windows.filled(t, y, nodes(order), half_way(order), min_points, order)
    return plus_of(windows, pilot, Seen.of(t), min_points)


def half_way(order: int) -> Floats:
    """Return ½ sin θᵢ·π/(K + 1), the half-widths of windows that reach half-way to their neighbours."""
    return np.asarray(0.5 * np.sqrt(1 - nodes(order) ** 2) * np.pi / (order + 1))


def plus_of(windows: Windows, pilot: ChebyshevFit, seen: Seen, min_points: int = MIN_POINTS) -> NodePlus:
    """Return the estimate of windows that have been filled."""
    order = windows.order
    found, d = windows.lines(pilot.domain, seen, min_points), transform(order)
    design = np.array([line.terms for line in found])  # L·T
    common = np.array([line.inside for line in found])  # of what the pilot saw as well
    at_nodes = np.array([line.value for line in found])  # L·y
    one, c = np.eye(order + 1), pilot.coefficients
    from_lines, from_pilot = np.zeros_like(d), one  # c = from_lines · L y + from_pilot · pilot
    tolerance = 1e-3 * pilot.bound + 1e-15 * np.abs(c).max()
    done = 0
    while done < ITERATIONS:
        done += 1
        step = d @ (at_nodes - design @ c)
        c, kept = c + step, one - d @ design
        from_lines, from_pilot = kept @ from_lines + d, kept @ from_pilot
        if np.all(np.abs(step) <= tolerance):
            break
    both = from_lines @ common @ pilot.inverse_gram @ from_pilot.T
    spread = from_lines @ windows.overlap(found) @ from_lines.T + from_pilot @ pilot.inverse_gram @ from_pilot.T
    covariance = pilot.noise_std**2 * (spread + both + both.T)
    return NodePlus(c, np.sqrt(np.diag(covariance)), covariance, done)
