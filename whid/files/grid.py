"""From raw columns to one uniform grid: time unit and order, jitter, rows left out, missing samples. Pure.

Every function takes `where`, sample → "file:row", so that a fault names its row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.operations._operation import Series
from whid.signal import Floats

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
JITTER = 0.01  # of a step, accepted with a note
LONGEST = 1e15  # s
GAP = 1.5  # steps: a longer one is taken for rows left out

Where = Callable[[int], str]
Bools = NDArray[np.bool_]


class Grid(NamedTuple):
    """A uniform grid, and where the rows of the file lie on it."""

    dt: float
    t0: float
    places: NDArray[np.intp] | None  # (rows,) None: every row is the next sample
    jitter: float  # largest deviation of a step, in steps


def check_order(time: Floats, where: Where) -> None:
    """Raise `WhidError` at the first time that is missing, absurd, or does not increase."""
    if not np.isfinite(time).all():
        row = int(np.flatnonzero(~np.isfinite(time))[0])
        raise WhidError("data-missing", "the time is missing", where(row))
    if float(np.abs(time).max()) > LONGEST:
        row = int(np.argmax(np.abs(time)))
        raise WhidError("data-range", f"the time is {time[row]:.3g} s here", where(row))
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        row = int(back[0]) + 1
        raise WhidError("data-time-order", f"time goes from {time[row - 1]:.10g} to {time[row]:.10g}", where(row))


def uniform(time: Floats, where: Where) -> Grid:
    """Return the grid of nearly uniform times; steps of several dt are rows left out.

    Raises `WhidError("data-time-step")` at the first step that deviates by more than 1 % of dt.

    >>> uniform(np.array([0.0, 0.1, 0.2, 0.4]), str).places
    array([0, 1, 2, 4])
    """
    steps = np.diff(time)
    dt = float(np.median(steps))
    whole = np.where(steps > GAP * dt, np.rint(steps / dt), 1.0)
    dt = tidy(float((time[-1] - time[0]) / whole.sum()), whole.sum(), float(time[-1]))
    deviation = np.abs(steps / dt - whole)
    worst = float(deviation.max())
    if worst > JITTER:
        row = int(np.flatnonzero(deviation > JITTER)[0]) + 1
        message = f"the step to this row is {steps[row - 1]:.6g} s, the others {dt:.6g} s (jitter {100 * worst:.3g} %)"
        raise WhidError("data-time-step", message, where(row))
    index = None if whole.max() == 1 else np.concatenate([[0], np.cumsum(whole)]).astype(np.intp)
    return Grid(dt, float(time[0]), index, worst)


def tidy(dt: float, steps: float, end: float = 0.0) -> float:
    """Return the decimal number that dt is but for rounding: over the whole record it must not move a sample.

    By no more, that is, than the digits that times have at its end, s: calendar times are good to 0.2 µs.

    >>> tidy(0.10000000000000002, 1000), tidy(0.1000000001, 899), tidy(0.1000000001, 899, end=1.7e9)
    (0.1, 0.1000000001, 0.1)
    """
    short = float(f"{dt:.9g}")
    return short if abs(short - dt) * steps <= 1e-9 * dt + 2 * np.spacing(abs(end)) else dt


def check_step(dt: float, declared: float, where: Where) -> None:
    """Raise `WhidError` when a time column contradicts a declared dt, and say so when it is a matter of the unit."""
    ratio = dt / declared
    if abs(ratio - 1) <= JITTER:
        return
    for unit, seconds in SECONDS.items():
        if unit != "s" and abs(ratio * seconds - 1) <= JITTER:
            message = f"the time column steps by {dt:.6g}, dt is {declared:.6g} s: the column is in {unit}, not in s"
            raise WhidError("data-time-unit", message, where(1))
    raise WhidError("data-time-step", f"the time column steps by {dt:.6g} s, dt says {declared:.6g} s", where(1))


def spread(x: Floats, grid: Grid) -> Floats:
    """Return a column on the grid, NaN where a row was left out."""
    if grid.places is None:
        return x
    full = np.full(int(grid.places[-1]) + 1, np.nan)
    full[grid.places] = x
    return full


def filled(x: Floats, known: Bools, hold: bool) -> Floats:
    """Return x with unknown samples held from the last known one, or joined by straight lines.

    >>> filled(np.array([1.0, np.nan, 3.0]), np.array([True, False, True]), hold=False)
    array([1., 2., 3.])
    """
    if known.all():
        return x
    at = np.flatnonzero(known)
    n = np.arange(len(x))
    if not hold:
        return np.asarray(np.interp(n, at, x[at]))
    return np.asarray(x[at[np.clip(np.searchsorted(at, n, side="right") - 1, 0, None)]])


def complete(time: Floats, u: Floats, y: Floats, missing: str, hold: bool, where: Where) -> tuple[Series, tuple[str, ...]]:
    """Return the series without NaN, missing outputs marked or filled as `missing` (error, mask, interpolate) says.

    Under mask a missing input is taken for held when it is the same on both sides, and refused otherwise: a model needs it.
    Raises `WhidError("data-missing")` at the first sample that may not be missing.
    """
    has_u, has_y = np.isfinite(u), np.isfinite(y)
    if has_u.all() and has_y.all():
        return Series(time, u, y, has_y), ()
    for known, column in ((has_u, "input"), (has_y, "output")):
        if not known.any():
            raise WhidError("data-missing", f"the {column} has no number at all", where(0))
    held, joined = filled(u, has_u, hold=True), filled(u, has_u, hold=False)
    refused = {"error": ~has_u | ~has_y, "mask": ~has_u & (held != joined), "interpolate": np.zeros(len(u), bool)}[missing]
    if refused.any():
        first = int(np.flatnonzero(refused)[0])
        what = (
            "input and output are"
            if not (has_u[first] or has_y[first])
            else f"the {'output' if has_u[first] else 'input'} is"
        )
        others = int(refused.sum()) - 1
        raise WhidError("data-missing", f"{what} missing here and at {others} more samples", where(first))
    found = ((int((~has_u).sum()), "inputs"), (int((~has_y).sum()), "outputs"))
    counts = " and ".join(f"{count} {what}" for count, what in found if count) + f" of {len(u)} missing"
    valid = has_y if missing == "mask" else np.ones(len(u), bool)
    done = "outputs masked" if missing == "mask" else "interpolated"
    return Series(time, held if hold else joined, filled(y, has_y, hold=False), valid), (f"{counts}: {done}",)
