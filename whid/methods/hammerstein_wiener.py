"""Hammerstein-Wiener: hard or piecewise affine input nonlinearity, linear block, polynomial output nonlinearity."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt

from whid.blocks.polynomial import Polynomial
from whid.errors import WhidError
from whid.methods import _assemble as assemble
from whid.methods import _piece_plans as plans
from whid.methods._audit import audit
from whid.methods._method import Method, Model, Stages, Wanted
from whid.methods._pieces_model import held_names, model_of, shift_of
from whid.methods._sines import Sine, gather
from whid.quantity import Measured
from whid.record import Record
from whid.refine import refine
from whid.residual import residual
from whid.signal import Floats, rms
from whid.stages._affine_fit import AffineFit, Levels, Tones
from whid.stages._visits import pooled
from whid.stages.constant_test import ConstantTest, constant_test
from whid.stages.input_pieces import Choice, InputPieces, input_pieces
from whid.stages.levels import StaticCurve, level_means
from whid.stages.lissajous import lissajous, paper_scale
from whid.stages.segmentation import Segmentation, segment
from whid.stages.settle import Settle, settle_time
from whid.stages.static_test import StaticTest, on_branch, static_test
from whid.stages.taylor import taylor
from whid.stages.transfer_function import TransferFunction, transfer_function
from whid.system import System

Asking = Generator[Any, Record | None, Any]
Reading = tuple[InputPieces, AffineFit, TransferFunction]

FINE = 1e-3  # of the range: a jump's gap that is not halved any more
SHARE = 0.9  # of a piece that a sine covers
OFF_CENTRE = np.array([[0.5, 0.5], [0.65, 0.35], [0.65, 0.35]])  # weights of its ends
PERIODS = 20
WORSE = 1.001  # residual of the whole-record fit over that of its start
NO_ROOT = "f(0) = 0 nowhere near the data: x = 0 is the middle of the anchor, f(0) a number"
ENOUGH = 6  # frequencies on the anchor: none are asked for
OCTAVES = 2.0 ** np.arange(6)


class Probe(NamedTuple):
    """A sine, the piece it was meant for, and what its tests say."""

    sine: Sine
    piece: int  # −1: on none
    constant: ConstantTest
    static: StaticTest

    @property
    def usable(self) -> bool:
        """Tell whether it moves the output along one static curve."""
        return self.piece >= 0 and self.static.static


class Curve(NamedTuple):
    """The staircase as it stands."""

    settles: list[Settle]
    seconds: float
    curve: StaticCurve
    pieces: Segmentation


@dataclass(frozen=True, kw_only=True)
class HammersteinWiener(Method):
    """Piecewise affine or hard h, linear G, polynomial f: from a staircase and sines on single pieces.

    y = f(G · h(u)), G(0) = 1, slope 1 on the piece that is measured best (the anchor), f(0) = 0 (normalisation unit_dc).
    The staircase gives the pieces, sines on one of them the phase of G (the output is then one static curve of the inner
    sine), f about it and |G|; levels and sines of the other pieces give h; then all numbers are fitted to all samples.
    Of a simulated plant it asks for what it needs: levels inside the gaps of the borders, a sine on every piece, sines at
    more frequencies on the anchor, a square wave where two values of h give the same level.

    degree     of f
    settle_s   settling time; left out: from the data
    rounds     of levels asked for inside the gaps
    whole_record  end with a fit of all numbers to all samples
    Source [Brouri2014].
    """

    normalisation: Literal["unit_dc"] = "unit_dc"
    degree: Annotated[int, Ge(1)] = 3
    settle_s: Annotated[float, Gt(0)] | None = None
    rounds: Annotated[int, Ge(0)] = 6
    whole_record: bool = True

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield settling, levels, pieces; the tests of the sines; f and G; h; the Model last."""
        bench = list(records)
        found: Curve = yield from self._staircase(bench)
        probes: list[Probe] = yield from self._probe(bench, found)
        anchor = self._anchor(probes)
        probes = yield from self._sweep(bench, found, probes, anchor)
        for probe in probes:
            yield probe.constant
            yield probe.static
        levels, tones = self._data(found, probes)
        here = levels.piece == anchor
        mine = [p for p in probes if p.usable and p.piece == anchor]
        own = tones.of(tones.piece == anchor)
        clear = sorted((p for p in mine if not p.static.ambiguous), key=lambda p: p.sine.omega)
        sizes = np.array([abs(p.sine.phasor) for p in clear])
        yield lissajous(np.array([p.sine.omega for p in clear]), [p.static for p in clear], sizes)
        series, first = taylor(Levels(*(each[here] for each in levels)), own, self.degree, [_phases(p.static) for p in mine])
        yield series
        known = Choice(levels, tones, found.pieces.degrees == 0, found.pieces.borders)
        pieces, fit = input_pieces(first, known)
        yield pieces
        linear = self._linear(pieces, fit, bench)
        if len(pieces.ambiguous):
            pieces, fit, linear = yield from self._audited(bench, found.seconds, known, first, (pieces, fit, linear))
        yield paper_scale(fit, pieces.estimate, shift_of(fit) or 0.0)
        yield linear
        staged = model_of(fit, pieces.estimate, pieces, linear)
        yield from self._finished(bench, staged, pieces, linear)

    def _staircase(self, bench: list[Record]) -> Asking:
        """Measure levels and cut them into pieces; ask for levels in the gaps of the borders until these are narrow."""
        found = self._curve(bench)
        for turn in range(self.rounds):
            span = float(np.ptp(found.curve.level))
            gap = np.diff(found.pieces.borders, axis=1)[:, 0]
            wide = found.pieces.borders[gap > FINE * span]
            if not len(wide):
                break
            noise = float(np.sqrt(found.curve.long_run_variance / np.median(found.curve.samples)))
            mean_s = float(np.median(found.curve.samples)) * bench[0].dt
            reason = f"borders of pieces, round {turn + 1}: the middle of {len(wide)} gaps of up to {gap.max():.3g}"
            answer = yield plans.levels(wide.mean(axis=1), found.seconds, mean_s, noise, reason)
            if answer is None:
                break
            bench.append(answer)
            found = self._curve(bench)
        yield from found.settles
        yield found.curve
        yield found.pieces
        return found

    def _curve(self, bench: Sequence[Record]) -> Curve:
        """Return the levels of all records, each record cut by its own settling time."""
        cut, level, way, settles = [], [], [], []
        for record in bench:
            visits = assemble.visits([record])
            if not visits:
                continue
            settle = settle_time([v.y for v in visits], record.dt)
            settles.append(settle)
            first = int(np.ceil((self.settle_s or settle.settle) / record.dt))
            cut += [v.y[first:] for v in visits]
            level += [v.level for v in visits]
            way += [v.direction for v in visits]
        if len(level) < 2:
            raise WhidError("method-no-levels", "hammerstein_wiener needs a staircase: two constant levels or more")
        curve = level_means(cut, np.array(level), np.array(way), bench[0].dt, 0.0)
        return Curve(settles, self.settle_s or settles[0].settle, curve, segment(curve, max_degree=self.degree))

    def _probe(self, bench: list[Record], found: Curve) -> Asking:
        """Ask for one slow sine on every piece; test all sines there are.

        Where a sine leaves its piece, or its curve is even about its middle, the next one is smaller and off centre.
        """
        share = np.full(len(found.pieces.degrees), SHARE)
        omega = 1 / max(found.seconds, 8 * bench[0].dt)
        for turn in range(3):
            probes = self._probes(bench, found)
            seen = {p.piece for p in probes if p.constant.constant or (p.usable and not p.static.ambiguous)}
            left = [k for k in range(len(share)) if k not in seen and np.ptp(_span(found, k)) > 0]
            if not left:
                break
            period = plans.periods_of(np.array([omega]), bench[0].dt)[0]
            parts = [
                plans.sine(float(_span(found, k) @ OFF_CENTRE[turn]), share[k] * np.ptp(_span(found, k)) / 2, period,
                           found.seconds / bench[0].dt, PERIODS) for k in left
            ]  # fmt: skip
            error = found.curve.noise_std * np.sqrt(2 / (PERIODS * period))
            answer = yield Wanted(tuple(parts), f"is the output constant, or one static curve, on {len(left)} pieces", error)
            if answer is None:
                break
            bench.append(answer)
            share[left] *= 0.6
        return self._probes(bench, found)

    def _sweep(self, bench: list[Record], found: Curve, probes: list[Probe], anchor: int) -> Asking:
        """Ask for sines on the anchor, an octave apart, then between those that still came through."""
        mine = [p for p in probes if p.usable and p.piece == anchor and not p.static.ambiguous]
        if len({p.sine.omega for p in mine}) >= ENOUGH:
            return probes
        first = min(mine, key=lambda p: p.static.phase_std)
        offset, amplitude = first.sine.offset, abs(first.sine.phasor)
        for turn in range(2):
            mine = [p for p in self._probes(bench, found) if p.usable and p.piece == anchor]
            omegas = np.unique([p.sine.omega for p in mine])
            wanted = omegas[0] * OCTAVES[1:] if not turn else np.sqrt(omegas[1:] * omegas[:-1])
            periods = plans.periods_of(wanted, bench[0].dt)
            parts = [plans.sine(offset, amplitude, p, found.seconds / bench[0].dt, PERIODS) for p in periods]
            answer = yield Wanted(tuple(parts), f"phase and gain at {len(parts)} frequencies", first.static.phase_std)
            if answer is None:
                break
            bench.append(answer)
        return self._probes(bench, found)

    def _probes(self, bench: Sequence[Record], found: Curve) -> list[Probe]:
        """Test every sine of all records; its phase on the branch of the staircase's slope."""
        probes = []
        for sine in gather(bench, found.seconds, 10, {}):
            piece = int(np.searchsorted(found.pieces.breaks, sine.offset, side="right"))
            inside = np.searchsorted(found.pieces.breaks, sine.offset + abs(sine.phasor) * np.array([-1, 1])) == piece
            static = static_test(sine.harmonics, self.degree, sine.phasor)
            slope = _slope(found.pieces, piece, sine.offset)
            probes.append(
                Probe(sine, piece if inside.all() else -1, constant_test(sine.harmonics), on_branch(static, slope))
            )
        return probes

    def _anchor(self, probes: Sequence[Probe]) -> int:
        """Return the piece whose sine tells the phase best."""
        moving = [p for p in probes if p.piece >= 0 and not p.constant.constant]
        if not moving:
            raise WhidError("method-nothing-moves", "no sine on one piece moves the output beyond noise")
        static = [p for p in moving if p.usable]
        if not static:
            raise WhidError("method-no-static-curve", "no sine makes the output a static curve of the inner sine")
        clear = [p for p in static if not p.static.ambiguous]
        if not clear:
            raise WhidError(
                "method-even-curve", "the curve under every sine is even: the phase is ambiguous by a quarter turn"
            )
        return min(clear, key=lambda p: p.static.phase_std).piece

    def _data(self, found: Curve, probes: Sequence[Probe]) -> tuple[Levels, Tones]:
        """Return the levels, each once, and the harmonics of the sines that stay on one piece."""
        level, mean, std, _, _ = pooled(found.curve, extra=found.pieces.visit_std**2)
        levels = Levels(level, mean, std, np.searchsorted(found.pieces.breaks, level, side="right"))
        used = [p for p in probes if p.usable]
        count = self.degree + 1
        floor = 1e-12 * float(np.abs(mean).max())
        return levels, Tones(
            np.array([p.sine.omega for p in used]), np.array([p.sine.offset for p in used]),
            np.array([p.sine.phasor for p in used]), np.array([p.sine.harmonics.value[:count] for p in used]),
            np.array([np.hypot(p.sine.harmonics.value_std[:count], floor) for p in used]), np.array([p.piece for p in used]),
        )  # fmt: skip

    def _audited(self, bench: list[Record], settle: float, known: Choice, first: AffineFit, best: Reading) -> Asking:
        """Let all samples decide between readings of the pieces; ask for square waves where they cannot."""
        pieces, _, linear = best
        readings = [best]
        for j in range(pieces.rivals.shape[1]):
            other = np.isfinite(pieces.rivals[:, j])
            value, slope = (np.where(other, r[:, j], own) for r, own in (
                (pieces.rivals, pieces.value), (pieces.rival_slopes, pieces.slope)
            ))  # fmt: skip
            forced = {k: (float(value[k]), float(slope[k])) for k in range(len(value)) if k != pieces.anchor}
            rival, fit = input_pieces(first, known, forced)
            readings.append((rival, fit, self._linear(rival, fit, bench)))
        models = [model_of(fit, p.estimate, p, g) for p, fit, g in readings]
        values, slopes = (np.array([getattr(p, name) for p, _, _ in readings]) for name in ("value", "slope"))
        verdict = audit(models, values, slopes, bench)
        if not verdict.decided:
            plan = plans.squares(pieces, linear, settle, bench[0].dt, PERIODS)
            reason = f"which of {len(readings)} readings of {len(plan)} pieces that the levels cannot tell apart"
            answer = yield Wanted(plan, reason, float(np.nanmin(np.abs(pieces.rivals - pieces.value[:, None]))))
            if answer is not None:
                bench.append(answer)
                verdict = audit(models, values, slopes, bench)
        yield verdict
        if not verdict.decided:
            return best
        found, fit, linear = readings[verdict.chosen]
        none = np.empty((len(found.centre), 0))
        found = found._replace(rivals=none, rival_slopes=none)
        yield found
        return found, fit, linear

    def _linear(self, pieces: InputPieces, fit: AffineFit, bench: Sequence[Record]) -> TransferFunction:
        m = len(fit.omegas)
        own = slice(len(pieces.estimate.values) - 2 * m, None)
        values, covariance = pieces.estimate.values[own], pieces.estimate.covariance[own, own]
        order = np.concatenate([np.arange(0, 2 * m, 2), np.arange(1, 2 * m, 2)])
        samples = sum(int(record.using("estimation").sum()) for record in bench)
        return transfer_function(fit.omegas, values[::2], values[1::2], covariance[np.ix_(order, order)], samples)

    def _finished(self, bench: Sequence[Record], staged: Model, pieces: InputPieces, linear: TransferFunction) -> Stages:
        """Yield the whole-record fit, where it is wanted, and the Model."""
        missing = (
            "the sign of G is a convention: (G, f(x)) and (−G, f(−x)) are one system; here G(0) = 1",
            *(() if _vanishes(staged.system) else (NO_ROOT,)),
            *pieces.doubts(),
        )
        if not self.whole_record:
            yield staged._replace(missing=missing)
            return
        jumps = tuple(f"chain.0.breaks.{k}" for k in np.flatnonzero(pieces.jump))
        held = held_names(staged.system, pieces.anchor) + jumps
        try:
            best = refine(staged.system, bench, fixed=held, periodic=True)
        except (WhidError, ValueError, np.linalg.LinAlgError) as fault:  # the stages before it still stand
            yield staged._replace(missing=(*missing, f"the whole-record fit failed: {fault}"))
            return
        yield best
        before = rms(np.concatenate([residual(staged.system.tree, record) for record in bench]))
        if float(np.sqrt(best.samples @ best.rms**2 / best.samples.sum())) > WORSE * before:
            yield staged._replace(missing=(*missing, "the whole-record fit found no minimum: these are the staged numbers"))
            return
        yield staged._replace(system=best.system, estimate=best.estimate, missing=missing + best.gauge)
        if best.estimate.why_stop == "interrupted":
            raise KeyboardInterrupt


def _vanishes(system: System) -> bool:
    f = system.chain[-1]
    return isinstance(f, Polynomial) and f.coefficients[0] == 0


def _span(found: Curve, piece: int) -> Floats:
    """Return the first and the last level of a piece."""
    low = float(found.curve.level.min()) if piece == 0 else float(found.pieces.borders[piece - 1, 1])
    high = float(found.curve.level.max()) if piece == len(found.pieces.breaks) else float(found.pieces.borders[piece, 0])
    return np.array([low, high])


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


def _phases(static: StaticTest) -> Floats:
    """Return the phases that a static test allows."""
    every = np.append(static.phase, static.rivals)
    return every if static.branch == "resolved" else np.concatenate([every, every + np.pi])
