"""Descent of filters and static curves in series on samples, from few data and few knots to all of both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.blocks._static import Static
from whid.blocks.spline import Spline, curvature
from whid.errors import WhidError
from whid.fit import Estimate, Parameter, Triangle, minimise
from whid.signal import Floats
from whid.stages import _forms as forms
from whid.stages._cascade import Cascade, Filter

ROWS = 8192  # rows that are reduced at once: a chunk stays in the cache
BENT = 30.0  # f″·(range of v)²/(range of f) that a curve is expected to have, root mean square: an arch has 8, a knee 20


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
    """Minimise Σ (y − ŷ)² over all free numbers of a cascade, with a weak prior on the bend of a spline.

    Each window starts in the steady state of its first input. The fit stops where no step would be longer than `tolerance`
    standard errors. A filter may not settle for longer than the longest window, unless it does at the start: it would learn
    the drift of that window, and go on with it in every other. The estimate names nothing but the order of the free ones of
    `Cascade.values`.
    """
    penalty, values, keep = _penalty(windows, start), start.values, start.free
    longest = float(max(len(window.u) for window in windows))
    longest = longest if start.slowest <= longest else np.inf

    def cascade(theta: Floats) -> Cascade:
        whole = values.copy()
        whole[keep] = theta
        return start.replaced(whole)

    def cost(theta: Floats) -> float:
        try:
            trial = cascade(theta)
        except WhidError:  # knots that have passed each other
            return float("inf")
        if not trial.stable or trial.slowest > longest:
            return float("inf")
        with np.errstate(all="ignore"):
            left = sum(float(np.sum(e**2)) for e in errors(windows, trial))
        return left + float(np.sum((penalty @ trial.values) ** 2))

    def linearise(theta: Floats) -> Triangle:
        return Triangle.stacked(_rows(windows, cascade(theta), penalty)).columns(keep)

    if not start.stable:
        raise WhidError("block-parameters", "a descent must start from stable filters")
    free = [p for p, kept in zip(_parameters(start), keep, strict=True) if kept]
    estimate = minimise(cost, linearise, free, known=False, max_iterations=max_iterations, tolerance=tolerance)
    return cascade(estimate.values), estimate


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
    return count * float(np.log(power * (1 - rho**2) / count)) + int(cascade.free.sum()) * float(np.log(count))


def reached(windows: Sequence[Window], cascade: Cascade) -> list[tuple[float, float]]:
    """Return the lowest and highest level at every curve."""
    levels = [[x for part, x in cascade.arriving(w.u) if isinstance(part, Static)] for w in windows]
    return [(min(float(x.min()) for x in each), max(float(x.max()) for x in each)) for each in zip(*levels, strict=True)]


def knotted(windows: Sequence[Window], cascade: Cascade, knots: int, *, by_bend: bool = True) -> Cascade:
    """Return the cascade with every curve that has knots on that many: where it bends, as dense as |f″|^½, or evenly.

    Between two curves a line may move from one to the other: of the first of them two points are held.
    """
    arriving = [[x for part, x in cascade.arriving(w.u) if isinstance(part, Static)] for w in windows]
    levels, parts = iter([np.concatenate(each) for each in zip(*arriving, strict=True)]), list[Filter | Static]()
    for part in cascade.parts:
        parts.append(part if isinstance(part, Filter) else forms.on(part, next(levels), knots, by_bend))
    return gauged(cascade._replace(parts=tuple(parts)))


def gauged(cascade: Cascade) -> Cascade:
    """Return the cascade with what its fit holds: of a curve in front of a filter and another curve the two points of the
    knots that lie farthest apart in height, not at the ends, where few samples are; of straight lines the outermost inputs.

    f → a·f + b in front of a filter of unit static gain is undone by the next curve; an outermost point may slide along
    its line.
    """
    held: list[int] = []
    curves = [k for k, part in enumerate(cascade.parts) if isinstance(part, Static)]
    for k, (part, at) in enumerate(cascade.places()):
        if isinstance(part, Static):
            between = k < curves[-1] and k + 1 not in curves
            held += [at.start + place for place in forms.loose(part) + (forms.pinned(part) if between else ())]
    return cascade._replace(held=tuple(held))


def rested(cascade: Cascade) -> Cascade:
    """Return the same cascade with 0 behind its first curve where 0 is in front of it: at rest the filter is at rest.

    Only of curve, filter, curve; what the next curve cannot undo stays as it is.
    """
    if [isinstance(part, Filter) for part in cascade.parts] != [False, True, False]:
        return cascade
    f, h, g = cascade.parts
    assert isinstance(f, Static)
    assert isinstance(g, Static)
    offset = float(f.value(np.zeros(1))[0])
    moved = forms.raised(f, -offset), forms.shifted(g, -offset)
    return cascade if moved[0] is None or moved[1] is None else cascade._replace(parts=(moved[0], h, moved[1]))


def _parameters(cascade: Cascade) -> list[Parameter]:
    found = []
    for part, at in cascade.places():
        own = None if isinstance(part, Filter) else part.parameters()
        for k, value in enumerate(cascade.values[at]):
            bounds = (-np.inf, np.inf) if own is None else (own[k].lower, own[k].upper)
            found.append(Parameter(str(at.start + k), float(value), "1", *bounds))
    return found


def _rows(windows: Sequence[Window], cascade: Cascade, penalty: Floats) -> Iterator[Floats]:
    """Yield [J | r], a chunk at a time."""
    for window in windows:
        y, rates = cascade.tangents(window.u)
        both = np.vstack([rates, y])[:, :: window.factor]
        both[-1] -= window.y
        both = both[:, window.use]
        for at in range(0, both.shape[1], ROWS):
            yield np.ascontiguousarray(both[:, at : at + ROWS].T)
    if len(penalty):
        yield np.column_stack([penalty, penalty @ cascade.values])


def _penalty(windows: Sequence[Window], start: Cascade) -> Floats:
    """Return rows P of a prior on splines: |P·outputs|² = (σ/BENT)² ∫ (f″·(range of v)²/(range of f))² dv/(range of v).

    It weighs as much as one sample or less; where hardly a sample lies it keeps the curve from following the noise.
    """
    rows = [np.zeros((0, len(start.values)))]
    for part, at in start.places():
        if isinstance(part, Spline):
            inputs, span = np.array(part.inputs), float(np.ptp(part.outputs)) or 1.0
            reach = inputs[-1] - inputs[0]
            share = (inputs[2:] - inputs[:-2]) / (2 * reach)
            own = np.zeros((len(share), len(start.values)))
            own[:, at] = np.sqrt(share)[:, None] * curvature(part.inputs)[1:-1] * reach**2 / span
            rows.append(own)
    penalty = np.vstack(rows)
    return np.asarray(penalty * rms_error(windows, start) / BENT) if len(penalty) else penalty
