"""From the sine parts of records to the data of the sine stages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from whid.record import Record
from whid.signal import Floats
from whid.stages._inner_harmonics import held_sine
from whid.stages._responses import Responses, StaticPart
from whid.stages.identifiability import nearest
from whid.stages.levels import StaticCurve
from whid.stages.periods import Harmonics, harmonics
from whid.stages.rational import Orders, Rational, rational
from whid.stages.segmentation import Segmentation


class Sine(NamedTuple):
    """One sine of a record: what went in, continuous in time, and the harmonics that came out."""

    omega: float  # rad/s
    offset: float
    phasor: complex
    harmonics: Harmonics


def gather(records: Sequence[Record], settle: float, highest: int, colour: dict[float, Floats]) -> list[Sine]:
    """Measure every estimation sine: the input's offset and phasor as they are in u, the output's harmonics.

    colour: the noise's autoregression by sampling time, as the levels show it.
    Whole lead periods are left out, as many as the settling time needs, not fewer than planned [PAPERS A, build 4].
    """
    found = []
    for record in records:
        y = np.where(record.mask, record.y, np.nan)
        for drive in drives(record, settle):
            highest_here = min(highest, drive.highest)
            out = harmonics(y[drive.part], drive.period, drive.skip, highest_here, colour.get(record.dt, np.empty(0)))
            found.append(Sine(drive.omega, drive.offset, drive.phasor, out))
    return found


class Drive(NamedTuple):
    """One sine as it is in the input of a record."""

    part: slice
    period: float  # samples
    skip: int  # periods left out
    omega: float
    offset: float
    phasor: complex

    @property
    def highest(self) -> int:
        """Return the highest harmonic that the sampling can tell."""
        return int(self.period / 2 - 1)


def drives(record: Record, settle: float) -> Iterator[Drive]:
    """Yield every estimation sine that has two periods after the settling time."""
    for part in record.select("sine"):
        period = float(part.period)  # type: ignore[attr-defined]
        skip = max(int(part.lead_periods), int(np.ceil(settle / (period * record.dt))))  # type: ignore[attr-defined]
        if part.length < (skip + 2) * period:
            continue
        stretch = slice(part.start, part.stop)
        into = harmonics(record.u[stretch], period, skip, count=1)
        omega = 2 * np.pi / (period * record.dt)
        first = complex(into.value[1])
        phasor = held_sine(abs(first), float(np.angle(first)), omega, record.dt, record.intersample)
        yield Drive(stretch, period, skip, omega, float(into.value[0].real), phasor)


def pieces_under(pieces: Segmentation, sine: Sine, gain: float = 1.0) -> tuple[int, int]:
    """Return the first and the last piece that a sine covers behind a front block of that gain."""
    reach = sine.offset + np.array([-1, 1]) * abs(sine.phasor) * gain
    low, high = np.searchsorted(pieces.breaks, reach)
    return int(low), int(high)


def is_smooth(pieces: Segmentation, sine: Sine) -> bool:
    """Tell whether a sine stays on one piece."""
    low, high = pieces_under(pieces, sine)
    return low == high


def degree_under(pieces: Segmentation, sine: Sine) -> int:
    """Return the degree of the piece at a sine's offset: the highest harmonic that f makes there."""
    return int(pieces.degrees[np.searchsorted(pieces.breaks, sine.offset)])


def responses_of(
    sines: Sequence[Sine], pieces: Segmentation, curve: StaticCurve, left: Sequence[bool], gain: Floats
) -> tuple[StaticPart, Responses]:
    """Return f where the sines run, and their harmonics: to the piece's degree, or all where a break is crossed.

    A sine that has left its piece, by its harmonics above the degree, takes the neighbouring pieces in. gain: of the front
    block, as far as it is known to be above 1.
    """
    spans = [pieces_under(pieces, sine, g) for sine, g in zip(sines, gain, strict=True)]
    low = max(min(a - gone for (a, _), gone in zip(spans, left, strict=True)), 0)
    high = min(max(b + gone for (_, b), gone in zip(spans, left, strict=True)), len(pieces.degrees) - 1)
    breaks = pieces.breaks[low:high]
    degrees = tuple(int(d) for d in pieces.degrees[low : high + 1])
    here = (np.searchsorted(pieces.breaks, curve.level, side="right") >= low) & (
        np.searchsorted(pieces.breaks, curve.level, side="right") <= high
    )
    error = np.hypot(curve.mean_std[here], pieces.visit_std)
    coefficients = np.nan_to_num(pieces.coefficients[low : high + 1, : max(degrees) + 1])
    kinks = tuple(int(k) for k in np.flatnonzero(~pieces.jump[low:high]))
    static = StaticPart(curve.level[here], curve.mean[here], error, breaks, coefficients, degrees, kinks)
    count = min(len(sine.harmonics.order) for sine in sines)
    orders = [
        range(count) if gone or a < b else range(degrees[a - low] + 1) for (a, b), gone in zip(spans, left, strict=True)
    ]
    return static, Responses(
        np.array([s.omega for s in sines]),
        np.array([s.offset for s in sines]),
        np.array([s.phasor for s in sines]),
        np.array([s.harmonics.value[:count] for s in sines]),
        np.array([s.harmonics.value_std[:count] for s in sines]),
        tuple(tuple(ks) for ks in orders),
    )


class ChainData(NamedTuple):
    """What the joint fits were fitted to, and which breaks of the part the sines cross and so locate."""

    static: StaticPart
    responses: Responses
    crossed: tuple[int, ...]
    opened: Floats  # breaks that the levels read as kinks and the sines as jumps


def fit_chain(
    sines: Sequence[Sine],
    pieces: Segmentation,
    curve: StaticCurve,
    left: Sequence[bool],
    samples: int,
    orders: Orders | None,
) -> tuple[ChainData, Rational]:
    """Fit f, front and back to levels and sines, with as many pieces as v reaches.

    Where the fitted front block carries v over more breaks than u reaches, their pieces are taken in and all is fitted
    anew. Where the harmonics contradict a kink that they cross, it may be a jump: if that explains them, it is one.
    """
    gain = np.ones(len(sines))
    for _ in range(3):
        static, responses = responses_of(sines, pieces, curve, left, gain)
        crossed = _crossed(static, responses, gain)
        fit = rational(static, responses, samples, orders, free_breaks=crossed, back=not is_affine(static))
        amplified = np.maximum(gain, fit.front_gain[nearest(fit.front_omega, responses.omega)])
        if all(
            pieces_under(pieces, s, a) == pieces_under(pieces, s, g) for s, a, g in zip(sines, amplified, gain, strict=True)
        ):
            break
        gain = amplified
    suspects = sorted({*static.kinks} & {*crossed})
    if suspects and not fit.explained:
        wider = static._replace(kinks=tuple(k for k in static.kinks if k not in suspects))
        other = rational(wider, responses, samples, orders, free_breaks=crossed)
        if other.estimate.chi2 < fit.estimate.chi2 - 10.8 * len(suspects):
            return ChainData(wider, responses, crossed, static.breaks[suspects]), other
    return ChainData(static, responses, crossed, np.empty(0)), fit


def is_affine(static: StaticPart) -> bool:
    """Tell whether the sines stay on one affine piece."""
    return not len(static.breaks) and max(static.degrees) < 2


def _crossed(static: StaticPart, responses: Responses, gain: Floats) -> tuple[int, ...]:
    near = np.abs(static.breaks[:, None] - responses.offset) < np.abs(responses.phasor) * gain
    return tuple(int(k) for k in np.flatnonzero(near.any(axis=1)))


def on_each_piece(static: StaticPart, responses: Responses) -> Iterator[Responses]:
    """Yield the sines piece by piece."""
    under = np.searchsorted(static.breaks, responses.offset)
    for piece in np.unique(under):
        here = np.flatnonzero(under == piece)
        arrays = {name: getattr(responses, name)[here] for name in ("omega", "offset", "phasor", "value", "value_std")}
        yield Responses(**arrays, orders=tuple(responses.orders[e] for e in here))


def unseen(pieces: Segmentation, data: ChainData) -> list[int]:
    """Return the kinks that no sine crosses."""
    first = int(np.searchsorted(pieces.breaks, data.static.breaks[0])) if len(data.static.breaks) else 0
    return [int(k) for k in np.flatnonzero(~pieces.jump) if k - first not in data.crossed]


def above_noise(responses: Responses, times: float = 5.0) -> Responses:
    """Return the responses with only those harmonics that stand out: without a model, |G_back| is free at every one."""
    size = np.abs(responses.value) > times * responses.value_std
    return responses._replace(
        orders=tuple(tuple(k for k in ks if k == 0 or size[e, k]) for e, ks in enumerate(responses.orders))
    )
