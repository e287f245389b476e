"""A filter through a short record in time: where a frequency response is too coarse to tell slow poles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whid.blocks.polynomial import Polynomial
from whid.errors import WhidError
from whid.fit import Estimate, linear_least_squares
from whid.signal import Floats
from whid.stages._cascade import Cascade, Filter
from whid.stages.cascade_fit import Window, cascade_fit, rms_error
from whid.stages.linear_fit import LinearFit

SLOWEST = (8, 30, 100)  # the longest time constant of a start, in parts of the record
APART = 3.0  # of one time constant from the next


def linear_in_time(windows: Sequence[Window], poles: int, dt: float, starts: Sequence[Filter] = ()) -> LinearFit:
    """Fit y = c + k·G(z)·u by least squares on the simulation error, from given filters and from real poles spread out.

    G has as many zeros as poles; the best of all starts is kept. Raises `WhidError("stage-no-linear-fit")` where none ends.
    """
    longest = max(len(w.u) for w in windows)
    spread = [_real(longest / part, poles) for part in SLOWEST]
    ends = [end for start in (*starts, *spread) if (end := _descended(windows, start, poles)) is not None]
    if not ends:
        raise WhidError("stage-no-linear-fit", f"no stable filter with {poles} poles fits in time")
    cascade, estimate = min(ends, key=lambda end: rms_error(windows, end[0]))
    best, (h, line) = rms_error(windows, cascade), cascade.parts
    assert isinstance(h, Filter)
    assert isinstance(line, Polynomial)
    count = sum(w.samples for w in windows)
    bic = count * 2 * np.log(best) + len(estimate.values) * np.log(count)
    return LinearFit(
        np.roots(h.den_z).astype(complex), np.roots(h.num_z).astype(complex), line.coefficients[1],
        np.array([[poles, poles]]), np.array([bic]), len(starts) + len(spread),
        sum(rms_error(windows, end) < 1.001 * best for end, _ in ends), estimate, dt,
    )  # fmt: skip


def _real(slowest: float, poles: int) -> Filter:
    return Filter.of_roots(np.empty(0, complex), np.exp(-(APART ** np.arange(poles)) / slowest) + 0j)


def _descended(windows: Sequence[Window], start: Filter, poles: int) -> tuple[Cascade, Estimate] | None:
    """Return the end of a descent, offset and gain first by linear least squares."""
    x, y = (np.concatenate(each) for each in zip(*(_through(w, start) for w in windows), strict=True))
    offset, gain = linear_least_squares(np.column_stack([np.ones(len(x)), x]), y).values
    try:
        return cascade_fit(windows, Cascade((start.padded(poles), Polynomial(coefficients=(offset, gain)))), 100)
    except WhidError:
        return None


def _through(window: Window, h: Filter) -> tuple[Floats, Floats]:
    return h.through(window.u)[:: window.factor][window.use], window.y[window.use]
