"""Corners and jumps rounded over a width: what a curve has more than its hard limit, near each of its breakpoints.

A corner is rounded by a parabola, a jump by a straight line, both as a moving average over the width would; beyond half the
width on either side of a breakpoint the curve is the hard one, exactly. Width 0 is the hard curve.

    ramp  ∫∫δ: max(x, 0) + bump(x),  bump = (width/2 − |x|)²/(2·width) for |x| < width/2, else 0
    step  ∫δ:  (x ≥ 0) + lean(x),    lean = bump′ = ½ + x/width − (x ≥ 0) there

Source [Giannoulis, Massberg and Reiss 2012, Digital Dynamic Range Compressor Design], eq. (4).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from whid.blocks._block import Free
from whid.errors import WhidError
from whid.signal import Floats

Knee = Annotated[float, Free("input", lower=0.0)] | None  # None: hard, and no number of a fit


def checked(knee: float | None) -> None:
    """Raise `WhidError("block-parameters")` for a negative width."""
    if knee is not None and knee < 0:
        raise WhidError("block-parameters", f"a knee is 0 wide or more, not {knee:g}")


def bump(x: Floats, knee: float | None) -> Floats:
    """Return what a rounded corner of slope change 1 has over the sharp one, x from the corner.

    >>> bump(np.array([-1.0, 0.0, 0.5, 1.0]), 2.0)
    array([0.    , 0.25  , 0.0625, 0.    ])
    """
    if not knee:
        return np.zeros_like(x)
    return np.asarray(np.maximum(knee / 2 - np.abs(x), 0.0) ** 2 / (2 * knee))


def lean(x: Floats, knee: float | None) -> Floats:
    """Return what a rounded jump of height 1 has over the sharp one: the derivative of the bump."""
    if not knee:
        return np.zeros_like(x)
    return np.asarray(np.where(np.abs(x) < knee / 2, 0.5 + x / knee - (x >= 0), 0.0))


def tilt(x: Floats, knee: float | None) -> Floats:
    """Return the slope of a rounded jump of height 1, x off the jump."""
    return np.where(np.abs(x) < knee / 2, 1 / knee, 0.0) if knee else np.zeros_like(x)


def wider(x: Floats, knee: float | None) -> Floats:
    """Return the derivative of the bump with respect to the width."""
    if not knee:
        return np.zeros_like(x)
    return np.where(np.abs(x) < knee / 2, 0.125 - 0.5 * (x / knee) ** 2, 0.0)


def flatter(x: Floats, knee: float | None) -> Floats:
    """Return the derivative of the lean with respect to the width."""
    return np.where(np.abs(x) < knee / 2, -x / knee**2, 0.0) if knee else np.zeros_like(x)


def edges(corners: Floats, knee: float | None) -> Floats:
    """Return the breakpoints of a rounded curve, ascending: half the width on either side of each corner."""
    return np.asarray(corners if not knee else np.sort(np.concatenate([corners - knee / 2, corners + knee / 2])))


def edge_rates(corners: Floats, rates: Floats, knee: float | None, *, widening: bool) -> Floats:
    """Return how the breakpoints move where the corners move at `rates`, or where the width grows."""
    if not knee:
        return np.zeros(len(corners)) if widening else rates
    order = np.argsort(np.concatenate([corners - knee / 2, corners + knee / 2]), kind="stable")
    half = np.repeat([-0.5, 0.5], len(corners))
    return np.asarray((half if widening else np.concatenate([rates, rates]))[order])
