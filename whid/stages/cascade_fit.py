"""Descent of a filter-curve-filter cascade on samples, from few data and few knots to all of both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.blocks._static import Static
from whid.blocks.spline import Spline, curvature
from whid.blocks.table import Table
from whid.errors import WhidError
from whid.fit import Estimate, Parameter, Triangle, minimise
from whid.signal import Floats
from whid.stages._cascade import Cascade

ROWS = 8192  # rows that are reduced at once: a chunk stays in the cache
BENT = 30.0  # f″·(range of v)²/(range of f) that a curve is expected to have, root mean square: an arch has 8, a knee 20
EVEN = 0.5  # knots spread evenly, over those placed by the bend


class Window(NamedTuple):
    """Input at `factor` times the rate of the output, and where the output counts."""

    u: Floats  # (factor·N,)
    y: Floats  # (N,)
    use: NDArray[np.bool_]  # (N,)
    factor: int = 1
    t0: float = 0.0  # time of the first sample, s

    @property
    def samples(self) -> int:
        """Return how many samples count."""
        return int(self.use.sum())


def cascade_fit(
    windows: Sequence[Window], start: Cascade, max_iterations: int = 25, tolerance: float = 0.03
) -> tuple[Cascade, Estimate]:
    """Minimise Σ (y − ŷ)² over all numbers of a cascade, with a weak prior on the bend of a spline.

    Each window starts in the steady state of its first input. The fit stops where no step would be longer than `tolerance`
    standard errors. The estimate names nothing but the order of `Cascade.values`.
    """
    penalty = _penalty(windows, start)
    curve = slice(at := len(start.front.num) + len(start.front.den), at + penalty.shape[1])

    def cost(theta: Floats) -> float:
        try:
            cascade = start.replaced(theta)
        except WhidError:  # knots that have passed each other
            return float("inf")
        if not cascade.stable:
            return float("inf")
        with np.errstate(all="ignore"):
            left = sum(float(np.sum(e**2)) for e in errors(windows, cascade))
        return left + float(np.sum((penalty @ theta[curve]) ** 2))

    def linearise(theta: Floats) -> Triangle:
        return Triangle.stacked(_rows(windows, start.replaced(theta), penalty, curve))

    free = [Parameter(str(k), float(value)) for k, value in enumerate(start.values)]
    if not start.stable:
        raise WhidError("block-parameters", "a descent must start from stable filters")
    estimate = minimise(cost, linearise, free, known=False, max_iterations=max_iterations, tolerance=tolerance)
    return start.replaced(estimate.values), estimate


def errors(windows: Sequence[Window], cascade: Cascade) -> Iterator[Floats]:
    """Yield ŷ − y of every window, where y counts."""
    for window in windows:
        yield (cascade.response(window.u)[:: window.factor] - window.y)[window.use]


def rms_error(windows: Sequence[Window], cascade: Cascade) -> float:
    """Return the root mean square error over all windows."""
    return float(np.sqrt(np.mean(np.concatenate(list(errors(windows, cascade))) ** 2)))


def bic(windows: Sequence[Window], cascade: Cascade) -> float:
    """Return N·log σ² + p·log N, σ² the error that is left when each residual is predicted from the one before it.

    Smaller is better. Drift and slow disturbances would otherwise pay for curves that follow them.
    """
    left = list(errors(windows, cascade))
    power, count = max(sum(float(e @ e) for e in left), 1e-300), sum(len(e) for e in left)
    rho = min(max(sum(float(e[1:] @ e[:-1]) for e in left) / power, 0.0), 0.99)
    return count * float(np.log(power * (1 - rho**2) / count)) + len(cascade.values) * float(np.log(count))


def reached(windows: Sequence[Window], cascade: Cascade) -> tuple[float, float]:
    """Return the lowest and highest level at the curve."""
    inner = [cascade.inner(window.u) for window in windows]
    return min(float(v.min()) for v in inner), max(float(v.max()) for v in inner)


def evenly(cascade: Cascade, span: tuple[float, float], knots: int) -> Cascade:
    """Return the cascade with its curve on evenly spaced knots."""
    return _on(cascade, np.linspace(*span, knots))


def by_bend(cascade: Cascade, span: tuple[float, float], knots: int) -> Cascade:
    """Return the cascade with knots where its curve bends: as dense as |f″|^½."""
    fine = np.linspace(*span, 1000)
    slope = np.gradient(cascade.curve.value(fine), fine)
    density = np.sqrt(np.abs(np.gradient(slope, fine)))
    share = np.cumsum(density + EVEN * max(float(density.mean()), 1e-300))
    share = (share - share[0]) / (share[-1] - share[0])
    inputs = np.interp(np.linspace(0, 1, knots), share, fine)
    return _on(cascade, inputs)


def curve_through(kind: str, inputs: Floats, outputs: Floats) -> Static:
    """Return a `spline` (knots held) or `hinges` (a table with free knots) through points."""
    points, heights = tuple(map(float, inputs)), tuple(map(float, outputs))
    return Spline(inputs=points, outputs=heights) if kind == "spline" else Table(inputs=points, outputs=heights)


def _on(cascade: Cascade, inputs: Floats) -> Cascade:
    kind = "spline" if isinstance(cascade.curve, Spline) else "hinges"
    return cascade._replace(curve=curve_through(kind, inputs, cascade.curve.value(inputs)))


def _rows(windows: Sequence[Window], cascade: Cascade, penalty: Floats, curve: slice) -> Iterator[Floats]:
    """Yield [J | r], a chunk at a time."""
    for window in windows:
        y, rates = cascade.tangents(window.u)
        both = np.vstack([rates, y])[:, :: window.factor]
        both[-1] -= window.y
        both = both[:, window.use]
        for at in range(0, both.shape[1], ROWS):
            yield np.ascontiguousarray(both[:, at : at + ROWS].T)
    stiff = np.zeros((len(penalty), len(cascade.values) + 1))
    stiff[:, curve] = penalty
    stiff[:, -1] = penalty @ cascade.values[curve]
    if len(stiff):
        yield stiff


def _penalty(windows: Sequence[Window], start: Cascade) -> Floats:
    """Return rows P of a prior on a spline: |P·outputs|² = (σ/BENT)² ∫ (f″·(range of v)²/(range of f))² dv/(range of v).

    It weighs as much as one sample or less; where hardly a sample lies it keeps the curve from following the noise.
    """
    if not isinstance(start.curve, Spline):
        return np.zeros((0, len(start.curve.parameters())))
    inputs, span = np.array(start.curve.inputs), float(np.ptp(start.curve.outputs)) or 1.0
    reach = inputs[-1] - inputs[0]
    share = (inputs[2:] - inputs[:-2]) / (2 * reach)
    bend = curvature(start.curve.inputs)[1:-1] * reach**2 / span
    return np.asarray(rms_error(windows, start) / BENT * np.sqrt(share)[:, None] * bend)
