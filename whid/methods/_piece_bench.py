"""What is measured of a piecewise affine input nonlinearity, and the experiments that are asked for while it is."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from whid.errors import WhidError
from whid.methods import _piece_plans as plans
from whid.methods import _visits
from whid.methods._method import Answered, Wanted
from whid.methods._sines import Sine, gather
from whid.quantity import Measured
from whid.record import Record
from whid.signal import Floats
from whid.stages._affine_fit import Levels, Tones
from whid.stages._visits import pooled
from whid.stages.constant_test import ConstantTest, constant_test
from whid.stages.input_pieces import Choice
from whid.stages.levels import StaticCurve, level_means
from whid.stages.segmentation import Segmentation, segment
from whid.stages.settle import Settle, settle_time
from whid.stages.static_test import StaticTest, on_branch, static_test

Asking = Generator[Any, Record | None, Any]

FINE = 1e-3  # of the range: a gap between levels that is not halved any more
SHARE = 0.9  # of a piece that a sine covers
SMALLER = 0.6  # times that, where it turned out to leave the piece
OFF_CENTRE = np.array([[0.5, 0.5], [0.65, 0.35], [0.65, 0.35]])  # weights of the piece's ends, try by try
SAME = 4.0  # standard errors of a level
PERIODS = 20
ENOUGH = 6  # frequencies on the anchor: none are asked for
OCTAVES = 2.0 ** np.arange(1, 6)


class Probe(NamedTuple):
    """A sine, the piece that it stays on (−1: on none), and what its tests say."""

    sine: Sine
    piece: int
    constant: ConstantTest
    static: StaticTest

    @property
    def usable(self) -> bool:
        """Tell whether the output is one static curve of it."""
        return self.piece >= 0 and self.static.static

    @property
    def clear(self) -> bool:
        """Tell whether that curve also tells the phase."""
        return self.usable and not self.static.ambiguous

    @property
    def phases(self) -> Floats:
        """Return the phases that the static test allows."""
        every = np.append(self.static.phase, self.static.rivals)
        return every if self.static.branch == "resolved" else np.concatenate([every, every + np.pi])


@dataclass
class Bench:
    """The records so far, and what they show: levels in pieces, sines on them."""

    records: list[Record]
    degree: int  # of the output nonlinearity
    settle_s: float | None
    rounds: int
    settles: list[Settle] = field(default_factory=list)
    curve: StaticCurve = field(init=False)
    pieces: Segmentation = field(init=False)
    probes: list[Probe] = field(default_factory=list)

    @property
    def dt(self) -> float:
        """Return the sampling time."""
        return self.records[0].dt

    @property
    def settle(self) -> float:
        """Return the settling time, s."""
        return self.settle_s or self.settles[0].settle

    @property
    def samples(self) -> int:
        """Return how many samples may be learned from."""
        return sum(int(record.using("estimation").sum()) for record in self.records)

    def staircase(self) -> Asking:
        """Measure levels and cut them into pieces; ask for levels in the gaps of the borders until these are narrow."""
        self._measure_levels()
        for turn in range(self.rounds):
            gaps = np.array([*self.pieces.borders, *self._doubtful_gaps()]).reshape(-1, 2)
            wide = gaps[np.diff(gaps, axis=1)[:, 0] > FINE * np.ptp(self.curve.level)]
            if not len(wide):
                break
            samples = float(np.median(self.curve.samples))
            error = float(np.sqrt(self.curve.long_run_variance / samples))
            reason = (
                f"borders of pieces, round {turn + 1}: the middle of {len(wide)} gaps of up to {np.diff(wide).max():.3g}"
            )
            answer = yield plans.levels(wide.mean(axis=1), self.settle, samples * self.dt, error, reason)
            if answer is None:
                break
            self.records.append(answer)
            self._measure_levels()
            gap = np.diff(self.pieces.borders, axis=1).max(initial=0.0)
            yield Answered(f"{len(self.pieces.degrees)} pieces, borders to {gap:.3g}")
        yield self.settles[0]
        yield self.curve
        yield self.pieces

    def probe(self) -> Asking:
        """Ask for one slow sine on every piece; test all sines there are.

        Where a sine leaves its piece, or its curve is even about its middle, the next one is smaller and off centre.
        """
        share = np.full(len(self.pieces.degrees), SHARE)
        period = plans.periods_of(np.array([1 / max(self.settle, 8 * self.dt)]), self.dt)[0]
        error = self.curve.noise_std * float(np.sqrt(2 / (PERIODS * period)))
        self._measure_sines()
        for weights in OFF_CENTRE:
            seen = {p.piece for p in self.probes if p.constant.constant or p.clear}
            left = [k for k in range(len(share)) if k not in seen and np.ptp(self.span(k)) > 0]
            if not left:
                break
            spans = [self.span(k) for k in left]
            parts = [
                plans.sine(float(span @ weights), s * float(np.ptp(span)) / 2, period, self.lead, PERIODS)
                for span, s in zip(spans, share[left], strict=True)
            ]
            reason = f"is the output constant, or one static curve, on {len(left)} pieces"
            answer = yield Wanted(tuple(parts), reason, error, "harmonic, output")
            if answer is None:
                break
            self.records.append(answer)
            self._measure_sines()
            new = self.probes[-len(left) :]
            flat, static = sum(p.constant.constant for p in new), sum(p.clear and not p.constant.constant for p in new)
            yield Answered(f"{flat} constant, {static} static, {len(new) - flat - static} neither, or even")
            share[left] *= SMALLER

    def anchor(self) -> int:
        """Return the piece whose sine tells the phase best."""
        moving = [p for p in self.probes if p.piece >= 0 and not p.constant.constant]
        if not moving:
            raise WhidError("method-nothing-moves", "no sine on one piece moves the output beyond noise")
        if not any(p.usable for p in moving):
            raise WhidError("method-no-static-curve", "no sine makes the output a static curve of the inner sine")
        clear = [p for p in moving if p.clear]
        if not clear:
            raise WhidError("method-even-curve", "under every sine the curve is even: phases a quarter turn apart fit alike")
        return min(clear, key=lambda p: p.static.phase_std).piece

    def sweep(self, anchor: int) -> Asking:
        """Ask for sines on the anchor, octaves above the slowest, then between those that still came through."""
        mine = [p for p in self.probes if p.clear and p.piece == anchor]
        first = min(mine, key=lambda p: p.static.phase_std)
        enough = len({p.sine.omega for p in mine}) >= ENOUGH
        for turn in range(0 if enough else 2):
            omegas = np.unique([p.sine.omega for p in self.on(anchor)])
            wanted = np.sqrt(omegas[1:] * omegas[:-1]) if turn else omegas[0] * OCTAVES
            offset, amplitude = first.sine.offset, abs(first.sine.phasor)
            parts = [plans.sine(offset, amplitude, p, self.lead, PERIODS) for p in plans.periods_of(wanted, self.dt)]
            reason = f"phase and gain at {len(parts)} frequencies"
            answer = (yield Wanted(tuple(parts), reason, first.static.phase_std, "phase, rad")) if parts else None
            if answer is None:
                break
            self.records.append(answer)
            self._measure_sines()
            heard = [p.static.phase_std for p in self.probes[-len(parts) :] if p.usable]
            yield Answered(f"{len(heard)} static" + (f", phase to {min(heard):.2g} … {max(heard):.2g} rad" if heard else ""))
        for probe in self.probes:
            yield probe.constant
            yield probe.static

    def on(self, piece: int) -> list[Probe]:
        """Return the usable sines on one piece, by frequency."""
        return sorted((p for p in self.probes if p.usable and p.piece == piece), key=lambda p: p.sine.omega)

    def data(self) -> Choice:
        """Return the levels, each once, the harmonics of the sines that stay on one piece, and the pieces' borders."""
        level, mean, std, _, _ = pooled(self.curve, extra=self.pieces.visit_std**2)
        levels = Levels(level, mean, std, np.searchsorted(self.pieces.breaks, level, side="right"))
        used, count = [p for p in self.probes if p.usable], self.degree + 1
        floor = 1e-12 * float(np.abs(mean).max())
        tones = Tones(
            np.array([p.sine.omega for p in used]), np.array([p.sine.offset for p in used]),
            np.array([p.sine.phasor for p in used]), np.array([p.sine.harmonics.value[:count] for p in used]),
            np.array([np.hypot(p.sine.harmonics.value_std[:count], floor) for p in used]), np.array([p.piece for p in used]),
        )  # fmt: skip
        return Choice(levels, tones, self.pieces.degrees == 0, self.pieces.borders)

    @property
    def lead(self) -> float:
        """Return the settling time in samples."""
        return self.settle / self.dt

    def span(self, piece: int) -> Floats:
        """Return the first and the last level of a piece."""
        ends = np.concatenate([[self.curve.level.min()], self.pieces.borders.ravel(), [self.curve.level.max()]])
        return np.asarray(ends[2 * piece : 2 * piece + 2])

    def _doubtful_gaps(self) -> list[Floats]:
        """Return the gaps beside a kink where a jump may hide: the level between fits the pieces on either side of it."""
        levels, found = np.unique(self.curve.level), []
        for k in np.flatnonzero(~self.pieces.jump):
            for near, away in zip(self.pieces.borders[k], (-1, 1), strict=True):
                rise = np.polynomial.polynomial.polyval(near, np.nan_to_num(np.diff(self.pieces.coefficients[k : k + 2].T)))
                place = int(np.searchsorted(levels, near)) + away
                if abs(float(rise[0])) < SAME * np.median(self.curve.mean_std) and 0 <= place < len(levels):
                    found.append(np.sort([near, levels[place]]))
        return found

    def _measure_levels(self) -> None:
        """Pool the levels of all records, each record cut by its own settling time: large steps take longer."""
        if len({round(record.dt, 15) for record in self.records}) > 1:
            raise WhidError("method-rates", "levels and sines are needed at one sampling time")
        cut, level, way = [], [], []
        self.settles = []
        for record in self.records:
            if visits := _visits.visits([record]):
                self.settles.append(settle_time([v.y for v in visits], record.dt))
                first = int(np.ceil((self.settle_s or self.settles[-1].settle) / record.dt))
                cut += [v.y[first:] for v in visits]
                level += [v.level for v in visits]
                way += [v.direction for v in visits]
        if len(level) < 2:
            raise WhidError("method-no-levels", "a staircase is needed: two constant levels or more")
        self.curve = level_means(cut, np.array(level), np.array(way), self.dt, 0.0)
        self.pieces = segment(self.curve, max_degree=self.degree)

    def _measure_sines(self) -> None:
        """Test every sine of all records; its phase on the branch of the staircase's slope."""
        self.probes = []
        for sine in gather(self.records, self.settle, 10, {self.dt: self.curve.ar}):
            piece = int(np.searchsorted(self.pieces.breaks, sine.offset, side="right"))
            reach = sine.offset + abs(sine.phasor) * np.array([-1, 1])
            inside = bool((np.searchsorted(self.pieces.breaks, reach) == piece).all())
            static = on_branch(
                static_test(sine.harmonics, self.degree, sine.phasor), _slope(self.pieces, piece, sine.offset)
            )
            self.probes.append(Probe(sine, piece if inside else -1, constant_test(sine.harmonics), static))


def _slope(pieces: Segmentation, piece: int, u: float) -> Measured:
    """Return the slope of the static curve at u with its error."""
    degree = int(pieces.degrees[piece])
    powers = np.arange(1, degree + 1)
    rate = powers * u ** (powers - 1.0)
    names = pieces.estimate.names
    place = [names.index(f"pieces.{piece}.{k}") for k in powers]
    covariance = pieces.estimate.covariance[np.ix_(place, place)]
    value = float(rate @ pieces.coefficients[piece, 1 : degree + 1])
    return Measured(value, float(np.sqrt(max(float(rate @ covariance @ rate), 0.0))))
