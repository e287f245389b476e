"""Does the input do between samples what is said of it."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np

from whid.fit import linear_least_squares
from whid.quantity import Quantity
from whid.signal import Floats
from whid.stages.causality import PREDICTABLE, whiten

Assumption = Literal["zoh", "foh", "bandlimited", "discrete"]
AHEAD, BEHIND = 6, 24  # lags of the response that are looked at
LONGEST = 100_000  # samples that are looked at
SMALL = 1e-5  # p of "no response there" below which there is some
SIZE, AHEAD_SIZE = 0.04, 0.06  # of the largest coefficient: a nonlinear plant leaves so much at lag 0, and ahead
HELD = 0.5  # of the samples equal to their predecessor: such an input is held


class Intersample(NamedTuple):
    """What the shortest lags of the response say about the input between samples."""

    declared: Assumption
    alternative: Assumption | None  # what fits better; None: nothing does, or the data cannot tell
    verdict: Literal["fits", "does not fit", "cannot tell"]
    statistic: Annotated[float, Quantity()]  # χ² of the coefficients that should be 0
    p: Annotated[float, Quantity()]
    reason: str


class _Short(NamedTuple):
    future: float  # χ² of lags −AHEAD … −1, and their size against the largest coefficient
    future_size: float
    same: float  # χ² of lag 0, and its signed size
    same_size: float
    next_size: float  # lag 1, and its χ²
    next: float


def intersample(u: Floats, y: Floats, declared: Assumption) -> Intersample:
    """Test a declared intersample assumption on the short-lag response of y to u.

    y(n) = Σ h(k) u(n − k) after prewhitening by u's autoregression, heteroscedastic standard errors (White 1980).
    Held input, strictly proper plant: h(k) = 0 for k ≤ 0. Straight lines: h(0) ≠ 0, h(k) = 0 for k < 0. Band-limited:
    sin(x)/x reaches ahead, h(k) ≠ 0 for k < 0. A plant whose response starts slowly hides all of this, and so
    does an input that is predictable (sines): then the data cannot tell. A direct path (feedthrough) looks like foh.

    u, y (N,), y without missing values.

    >>> rng = np.random.default_rng(3)
    >>> u = rng.standard_normal(4000)
    >>> y = 0.1 * rng.standard_normal(4000) + np.convolve(u, np.append(0.0, 0.8 ** np.arange(30)))[:4000]
    >>> intersample(u, y, "zoh").verdict, intersample(u, y, "foh").alternative
    ('fits', 'zoh')
    """
    from scipy.special import chdtrc

    held = float(np.mean(np.diff(u) == 0)) > HELD
    if held and declared == "bandlimited":
        return Intersample(declared, "zoh", "does not fit", np.nan, 0.0, "most input samples repeat the one before: held")
    h = _short_lags(u[:LONGEST], y[:LONGEST])
    if h is None:
        return Intersample(declared, None, "cannot tell", np.nan, np.nan, "the input is predictable, or the record short")
    p_future, p_same = float(chdtrc(AHEAD, h.future)), float(chdtrc(1, h.same))
    ahead = p_future < SMALL and h.future_size > AHEAD_SIZE and not held
    at_once = p_same < SMALL and abs(h.same_size) > SIZE
    if ahead:
        fits: tuple[Assumption, ...] = ("bandlimited",)
        statistic, p, reason = h.future, p_future, "y answers before u moves: the input is smooth between samples"
    elif at_once:
        fits = ("foh", "bandlimited")
        statistic, p, reason = h.same, p_same, "y answers u in the same sample: straight lines, or a direct path"
    elif h.next_size > SIZE and _sharp(h):
        fits = ("zoh", "discrete")
        statistic, p, reason = h.next, float(chdtrc(1, h.next)), "y answers one sample after u and not before: held"
    else:
        statistic, p = max((h.future, p_future), (h.same, p_same), key=lambda pair: -pair[1])
        return Intersample(declared, None, "cannot tell", statistic, p, "the response starts too slowly, or in the noise")
    if declared in fits:
        return Intersample(declared, None, "fits", statistic, p, reason)
    return Intersample(declared, fits[0], "does not fit", statistic, p, reason)


def _a_few_sines(u: Floats) -> bool:
    """Tell whether the best prediction of u from its past leaves next to nothing: fewer lines than lags that are looked at.

    Whitening by a tapered covariance leaves a thousandth of them, which is no innovation, but answers to them.
    """
    past = np.lib.stride_tricks.sliding_window_view(u - u.mean(), AHEAD + BEHIND + 2)
    found = linear_least_squares(past[:, :-1], past[:, -1])
    return bool(found.chi2 < PREDICTABLE * len(past) * u.var())


def _sharp(h: _Short) -> bool:
    """Tell whether lag 1 is known so well that the lag 0 of straight lines, a fourteenth of it or more, would show."""
    error = abs(h.next_size) / max(np.sqrt(h.next), 1e-300)
    return bool(abs(h.same_size) + 3 * error < abs(h.next_size) / 14)


def _short_lags(u: Floats, y: Floats) -> _Short | None:
    """Return the response at lags −AHEAD … 1, by least squares on lags −AHEAD … BEHIND of the whitened input."""
    whitened = whiten(u, y) if len(u) >= 10 * (AHEAD + BEHIND) else None
    if whitened is None or _a_few_sines(u):
        return None
    e, z = whitened
    design = np.lib.stride_tricks.sliding_window_view(e, AHEAD + BEHIND + 1)[:, ::-1]  # column j: lag j − AHEAD
    target = z[BEHIND : len(z) - AHEAD]
    gram = design.T @ design
    if np.linalg.cond(gram) > 1e8:
        return None
    inverse = np.linalg.inv(gram)
    h = inverse @ (design.T @ target)
    scores = design * (target - design @ h)[:, None]
    covariance = inverse @ (scores.T @ scores) @ inverse * len(target) / (len(target) - len(h))
    largest = float(np.abs(h).max())
    if not largest > 0 or not np.all(np.diag(covariance) > 0):
        return None
    future = h[:AHEAD] @ np.linalg.solve(covariance[:AHEAD, :AHEAD], h[:AHEAD])
    single = h**2 / np.diag(covariance)
    size = h / largest
    return _Short(
        float(future),
        float(np.abs(size[:AHEAD]).max()),
        float(single[AHEAD]),
        float(size[AHEAD]),
        float(size[AHEAD + 1]),
        float(single[AHEAD + 1]),
    )
