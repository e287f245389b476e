"""What happens when, found in the input itself: constant levels and sines (`parts: auto`)."""

from __future__ import annotations

import numpy as np

from whid.experiments._part import Part, Use
from whid.experiments.hold import Hold
from whid.experiments.sine import Sine
from whid.signal import Floats
from whid.stages._holds import Stretch, believed, constant, find_holds, least_bit, steps
from whid.stages._sines import FIRST_WINDOW, Found, find_sines, fitted

NEAR, PASSES = 32, 6  # samples about a border within which it is placed anew, and how often
TIE = 12.0  # χ² within which two places of a border are as good as each other
SAME = 1e-9  # relative: a number so near to a short one is that number


def find_parts(u: Floats, dt: float, use: Use = "estimation") -> tuple[Part, ...]:
    """Return the constant levels and the sines of an input, in time order; what is neither belongs to no part.

    u (N,) in its own unit, one bit of noise or a few per mille of white noise allowed. Levels are means over their
    stretch, levels that agree within a bit or their errors are made equal; periods are real numbers of samples, whole
    ones where such a one lies within the error.
    The first level has the direction of the step that follows it.

    >>> u = np.concatenate([np.repeat([0.0, 1.0], 20), 1 + 0.5 * np.cos(np.arange(120) * 2 * np.pi / 40.5)])
    >>> for part in find_parts(u, 0.1):
    ...     print(part.kind, part.start, part.stop, getattr(part, "level", None) or getattr(part, "period", None))
    hold 0 20 None
    hold 20 40 1.0
    sine 40 160 40.5
    """
    if len(u) < FIRST_WINDOW or not np.isfinite(u).all() or np.ptp(u) == 0:
        return ()
    bit = least_bit(u)
    holds = find_holds(u, bit)
    firm = [hold for hold in holds if all(steps(u, hold, bit))]
    sines = [sine for gap in _gaps(firm, len(u)) for sine in find_sines(u, gap.start, gap.stop, bit)]
    left = [rest for hold in holds if (rest := _left_of(hold, sines)) is not None]
    left += [hold for gap in _beside(sines, left, len(u)) for hold in constant(u, gap, bit) if believed(u, hold, bit)]
    pieces = _bordered(u, sorted([*left, *sines], key=lambda piece: piece.start))
    return _parts(u, pieces, bit, use)


def _left_of(hold: Stretch, sines: list[Found]) -> Stretch | None:
    """Return what sines leave of a level: nothing of the flat top of a coarse sine, all but an edge of a neighbour."""
    start, stop = hold
    for sine in sines:
        if min(stop, sine.stop) - max(start, sine.start) > 0:
            start, stop = (sine.stop, stop) if sine.start <= start else (start, sine.start)
    return Stretch(start, stop) if 2 * (stop - start) > hold.stop - hold.start else None


def _beside(sines: list[Found], holds: list[Stretch], samples: int) -> list[Stretch]:
    """Return what is left free next to a sine: a level of the sine's mean does not show as a change of the mean."""
    pieces = sorted([(sine.start, sine.stop) for sine in sines] + [tuple(hold) for hold in holds])
    ends = {edge for sine in sines for edge in (sine.start, sine.stop)}
    return [gap for gap in _gaps([Stretch(*piece) for piece in pieces], samples) if ends & {*gap}]


def _gaps(holds: list[Stretch], samples: int) -> list[Stretch]:
    edges = [0, *(edge for hold in holds for edge in hold), samples]
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [Stretch(a, b) for a, b in pairs if b - a >= FIRST_WINDOW]


def _bordered(u: Floats, pieces: list[Stretch | Found]) -> list[Stretch | Found]:
    """Place the borders of sines where both sides fit best, again and again as the sines are refitted."""
    for _ in range(PASSES):
        before = [piece.start for piece in pieces]
        for k in range(len(pieces) - 1):
            left, right = pieces[k], pieces[k + 1]
            if abs(right.start - left.stop) <= NEAR and (isinstance(left, Found) or isinstance(right, Found)):
                border = _border(u, left, right)
                pieces[k], pieces[k + 1] = _moved(u, left, left.start, border), _moved(u, right, border, right.stop)
        if before == [piece.start for piece in pieces]:
            break
    return pieces


def _border(u: Floats, left: Stretch | Found, right: Stretch | Found) -> int:
    """Return where left should end and right begin; of places that noise cannot tell apart, that of whole periods."""
    low = max(left.start + 1, min(left.stop, right.start) - NEAR)
    high = min(right.stop - 1, max(left.stop, right.start) + NEAR)
    n, x = np.arange(low, high, dtype=float), u[low:high]
    past = np.concatenate([[0.0], np.cumsum((x - _values(u, left, n)) ** 2)])
    coming = np.concatenate([np.cumsum(((x - _values(u, right, n)) ** 2)[::-1])[::-1], [0.0]])
    scale = max(getattr(left, "rms", 0.0), getattr(right, "rms", 0.0), 1e-9 * float(np.ptp(u)))
    ties = np.flatnonzero(past + coming <= (past + coming).min() + TIE * scale**2)
    return low + int(min(ties, key=lambda j: _uneven(left, right, low + int(j))))


def _values(u: Floats, piece: Stretch | Found, n: Floats) -> Floats:
    return piece.at(n) if isinstance(piece, Found) else np.full(len(n), u[piece.start : piece.stop].mean())


def _uneven(left: Stretch | Found, right: Stretch | Found, border: int) -> float:
    """Return by how many samples the left sine misses whole periods, and the right one a start at a quarter of a turn."""
    miss = 0.0
    if isinstance(left, Found):
        periods = (border - left.start) / left.period
        miss += left.period * abs(periods - round(periods))
    if isinstance(right, Found):
        quarters = 4 * ((border - right.start) / right.period + right.phase / (2 * np.pi))
        miss += right.period / 4 * abs(quarters - round(quarters))
    return miss


def _moved(u: Floats, piece: Stretch | Found, start: int, stop: int) -> Stretch | Found:
    return fitted(u, start, stop, piece) if isinstance(piece, Found) else Stretch(start, stop)


def _parts(u: Floats, pieces: list[Stretch | Found], bit: float, use: Use) -> tuple[Part, ...]:
    holds = [piece for piece in pieces if isinstance(piece, Stretch)]
    levels = dict(zip(holds, _levels(u, holds, bit), strict=True))
    parts: list[Part] = []
    for k, piece in enumerate(pieces):
        if isinstance(piece, Found):
            parts.append(_sine(piece.of_whole_samples(), use))
            continue
        before, here = pieces[k - 1] if k else None, levels[piece]
        after = pieces[k + 1] if k + 1 < len(pieces) else None
        if isinstance(before, Stretch):
            up: bool | None = here >= levels[before]
        else:
            up = levels[after] >= here if isinstance(after, Stretch) else None
        direction = None if up is None else "up" if up else "down"
        parts.append(Hold(start=piece.start, stop=piece.stop, level=here, direction=direction, use=use))  # type: ignore[arg-type]
    return tuple(parts)


def _levels(u: Floats, holds: list[Stretch], bit: float) -> list[float]:
    """Return the mean of every hold, those that agree within their errors (or half a bit) given one value."""
    if not holds:
        return []
    means = np.array([u[a] if np.ptp(u[a:b]) == 0 else u[a:b].mean() for a, b in holds])
    errors = np.array([u[a:b].std() / np.sqrt(b - a) for a, b in holds])
    counts = np.array([b - a for a, b in holds], float)
    noisy = errors.max() > 0
    reach = 5 * errors.max() + (0.5 * bit if noisy else 0.0) + SAME * float(np.ptp(u))
    order = np.argsort(means)
    group = np.empty(len(holds), int)
    group[order] = np.concatenate([[0], np.cumsum(np.diff(means[order]) > reach)])
    total = np.bincount(group, counts)
    values = np.bincount(group, counts * means) / total
    return [_short(float(values[g]), float(np.ptp(u))) for g in group]


def _sine(found: Found, use: Use) -> Sine:
    period = _short(found.period, found.period)
    return Sine(
        start=found.start,
        stop=found.stop,
        offset=_short(found.offset, found.amplitude),
        amplitude=_short(found.amplitude, found.amplitude),
        period=period,
        periods=max(1, int((found.stop - found.start) / period + 1e-3) - 1),
        phase=_short(found.phase, 1.0),
        use=use,
    )


def _short(x: float, scale: float) -> float:
    """Return the short decimal number that x is but for rounding.

    >>> _short(0.30000000000000004, 1.0), _short(1e-12, 1.0), _short(1 / 3, 1.0) == 1 / 3
    (0.3, 0.0, True)
    """
    short = round(x, 6 - int(np.floor(np.log10(scale)))) if scale > 0 else x
    return short + 0.0 if abs(short - x) <= SAME * scale else x
