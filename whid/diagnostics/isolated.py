"""Single wild samples, seen in the raw output."""

from __future__ import annotations

import numpy as np

from whid.diagnostics.standing import Bools
from whid.signal import Floats

FAR = 10.0  # of what a sample usually stands out of its neighbours: the tail of no noise that is near normal
ALONE = 4.0  # times the neighbours' own difference, and what others near stand out by: no step, no slow wave, no ringing
REACH = 5  # samples near
BEFORE = 5  # samples: an input that jumped so shortly before may have made the peak itself


def isolated(y: Floats, u: Floats, use: Bools) -> Bools:
    """Return the samples that stand out of both neighbours by far, while the input did nothing unusual, (N,).

    d(n) = y(n) − (y(n−1) + y(n+1))/2 against FAR times its median size, the neighbours' difference, and d near n.

    >>> y = np.sin(np.arange(200) / 9) + 0.01 * np.random.default_rng(0).standard_normal(200)
    >>> y[77] += 1.0
    >>> np.flatnonzero(isolated(y, np.sin(np.arange(200) / 9), np.ones(200, bool)))
    array([77])
    """
    known = np.where(use, y, np.nan)
    values = np.unique(known[np.isfinite(known)])
    found = np.zeros(len(y), bool)
    if len(y) < 3 or len(values) < 3:
        return found
    out = np.full(len(y), np.nan)
    out[1:-1] = np.abs(known[1:-1] - (known[:-2] + known[2:]) / 2)
    size = max(_usual(out), float(np.diff(values).min()), 1e-6 * float(values[-1] - values[0]))
    beside = np.full(len(y), np.nan)
    beside[1:-1] = np.abs(known[2:] - known[:-2]) / 2
    padded = np.pad(np.nan_to_num(out), REACH)
    near = np.max([padded[REACH + k : REACH + k + len(y)] for k in range(-REACH, REACH + 1) if abs(k) > 1], axis=0)
    with np.errstate(invalid="ignore"):
        found = (out > FAR * size) & (out > ALONE * beside) & (out > ALONE * near)
    jump = np.abs(np.diff(u, prepend=u[:1]))
    unusual = jump > FAR * max(_usual(jump), 1e-12)
    recent = np.convolve(unusual, np.ones(BEFORE + 1), "full")[: len(u)] > 0
    return np.asarray(found & ~recent)


def _usual(size: Floats) -> float:
    """Return the median size as a standard deviation."""
    known = size[np.isfinite(size)]
    return float(np.median(known)) / 0.6745 if len(known) else float("nan")
