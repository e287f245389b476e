"""From the sine parts of records to averaged periods, and from their joint fit to a Model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.blocks.backlash import Backlash
from whid.blocks.delay import Delay
from whid.blocks.linear import Linear
from whid.blocks.polynomial import Polynomial
from whid.fit import Estimate, Parameter
from whid.methods._method import Model
from whid.quantity import Cell, Measured, Quantity, Table
from whid.record import Record
from whid.refine import Refined, refine
from whid.signal import Floats
from whid.stages._hysteresis import CONSTANT, FULL, Swing, steady_loop
from whid.stages._inner_harmonics import held_sine
from whid.stages._loop_fit import LoopFit, rational_gains
from whid.stages.joint_loops import JointLoops
from whid.stages.noise_colour import ROUNDING, NoiseColour, noise_colour
from whid.stages.periods import Harmonics, harmonics, period_average
from whid.stages.transfer_function import TransferFunction
from whid.system import System

HARMONICS = 20
STRAYED = 1e-3  # p of the first period kept against the others, below which it is not settled
CENTRED = 1e-6  # offset over amplitude: more is a sine about an offset


class Seen(NamedTuple):
    """One sine of a record."""

    swing: Swing
    harmonics: Harmonics
    skipped: int
    rest: Floats  # what the averaged period leaves over, NaN where missing


class SettledPeriods(NamedTuple):
    """Settled periods: how many of each sine were left out as transient, and kept."""

    omega: Annotated[Floats, Quantity("rad/s", ("sine",))]
    amplitude: Annotated[Floats, Quantity("input", ("sine",))]
    skipped: tuple[int, ...]
    kept: tuple[int, ...]
    noise_std: Annotated[Floats, Quantity("output", ("sine",))]

    def table(self) -> Table:
        """Return one row a sine."""
        rows = tuple(
            (float(f"{w:.6g}"), float(f"{u:.6g}"), s, k, float(f"{n:.3g}"))
            for w, u, s, k, n in zip(self.omega, self.amplitude, self.skipped, self.kept, self.noise_std, strict=True)
        )
        return Table("Settled periods", ("ω, rad/s", "amplitude", "left out", "averaged", "noise std"), rows)


class Gathered(NamedTuple):
    """The sines of the records that can be used, and why the others cannot, in words."""

    sines: list[Seen]
    left_out: tuple[str, ...]


def gather(records: Sequence[Record]) -> Gathered:
    """Average the settled periods of every estimation sine about zero; lead periods are left out, more where they drift."""
    found, short, aside = [], [], []
    for record in records:
        for part in record.select("sine"):
            period, lead = float(part.period), int(part.lead_periods)  # type: ignore[attr-defined]
            stretch = slice(part.start, part.stop)
            y = np.where(record.mask, record.y, np.nan)[stretch]
            omega = 2 * np.pi / (period * record.dt)
            if len(y) < (lead + 2) * period:
                short.append(f"{omega:.4g} rad/s")
                continue
            skip = _settled(y, period, lead)
            into = harmonics(record.u[stretch], period, skip, count=1)
            first = complex(into.value[1])
            if abs(into.value[0].real) > CENTRED * abs(first):
                aside.append(f"{omega:.4g} rad/s about {into.value[0].real:.4g}")
                continue
            phasor = held_sine(abs(first), float(np.angle(first)), omega, record.dt, record.intersample)
            average = period_average(y, period, skip, max(2, int(period / 2) - 1))
            out = harmonics(y, period, skip, max(2, min(HARMONICS, int(period / 2) - 1)))
            floor = 1e-9 * max(float(np.ptp(average.mean)), 1e-300)
            std = np.hypot(average.mean_std, floor)
            rest = _rest(y, period, skip, average.mean)
            found.append(Seen(Swing(omega, phasor, average.mean, std, average.periods), out, skip, rest))
    said = []
    if aside:
        why = "about an offset the constant part of the inner signal is one more unknown; only sines about zero will do"
        said.append(f"left out, {len(aside)} of the sines ({', '.join(aside)}): {why}")
    if short:
        said.append(f"left out, {len(short)} of the sines ({', '.join(short)}): fewer than two periods after the lead")
    return Gathered(found, tuple(said))


def _rest(y: Floats, period: float, skip: int, mean: Floats) -> Floats:
    """Return the kept periods less their mean, which is between its samples its Fourier sum."""
    n, first = len(mean), int(np.ceil(skip * period - 1e-6))
    kept = y[first:]
    if abs(period - n) < 1e-9 * period:
        return np.asarray(kept - mean[np.arange(first, len(y)) % n])
    spectrum, phase = np.fft.rfft(mean) / n, np.exp(2j * np.pi * (np.arange(first, len(y)) / period))
    value = np.zeros(len(kept), complex)
    for c in spectrum[::-1]:  # Horner
        value = value * phase + c
    return np.asarray(kept - (2 * value.real - spectrum[0].real))


def colour(sines: Sequence[Seen]) -> NoiseColour:
    """Return whether the noise is white; the period average takes one part in P of it."""
    floor = [ROUNDING * float(np.ptp(s.swing.mean)) for s in sines]
    rests = [np.where(np.nanstd(s.rest) > f, s.rest, 0.0) for s, f in zip(sines, floor, strict=True)]
    return noise_colour(rests, lost=[1 / s.swing.periods for s in sines])


def settled(sines: Sequence[Seen]) -> SettledPeriods:
    """Return what was left out."""
    return SettledPeriods(
        np.array([s.swing.omega for s in sines]), np.array([s.swing.amplitude for s in sines]),
        tuple(s.skipped for s in sines), tuple(s.swing.periods for s in sines),
        np.array([s.harmonics.noise_std for s in sines]),
    )  # fmt: skip


def _settled(y: Floats, period: float, lead: int) -> int:
    """Return how many periods to leave out: the first one kept must be like the mean of those after it."""
    from scipy.special import fdtrc

    n = round(period)
    if abs(period - n) > 1e-9 or not np.isfinite(y).all():
        return lead
    folded = y[: len(y) // n * n].reshape(-1, n)
    for skip in range(lead, max(lead + 1, len(folded) // 2)):
        first, rest = folded[skip], folded[skip + 1 :]
        if len(rest) < 2:
            break
        scatter = float(np.sum((rest - rest.mean(axis=0)) ** 2)) / ((len(rest) - 1) * n)
        floor = max((1e-9 * float(np.ptp(rest))) ** 2, 1e-300)  # an output that rests, without noise, has settled
        ratio = float(np.mean((first - rest.mean(axis=0)) ** 2)) / ((scatter + floor) * (1 + 1 / len(rest)))
        if fdtrc(n, (len(rest) - 1) * n, ratio) > STRAYED:
            return skip
    return min(skip, len(folded) - 2)


class Admissible(NamedTuple):
    """Admissible: the loop of every sine, and what the fitted borders predict at other amplitudes."""

    omega: Annotated[Floats, Quantity("rad/s", ("sine",))]
    amplitude: Annotated[Floats, Quantity("input", ("sine",))]
    kind: tuple[str, ...]
    factor: Annotated[Floats, Quantity("1", ("factor",))]
    predicted: tuple[str, ...]  # sine by sine, for every factor of its amplitude

    def table(self) -> Table:
        """Return one row a sine."""
        k = len(self.factor)
        rows: tuple[tuple[Cell, ...], ...] = tuple(
            (float(f"{w:.6g}"), float(f"{u:.6g}"), kind, *self.predicted[i * k : (i + 1) * k])
            for i, (w, u, kind) in enumerate(zip(self.omega, self.amplitude, self.kind, strict=True))
        )
        columns = ("ω, rad/s", "amplitude", "loop", *(f"at {f:g} ×" for f in self.factor))
        note = "predicted from the borders, beyond the largest amplitude by extrapolation; a larger one need not help"
        return Table("Admissible amplitudes", columns, rows, (note,))


def admissible(swings: Sequence[Swing], joint: JointLoops) -> Admissible:
    """Return the loop at the amplitudes that were there and at multiples of them ([Giri], Proposition 1(3) is not so)."""
    factor = np.array([0.25, 0.5, 2.0, 4.0])
    predicted = []
    for swing in swings:
        gain = float(np.interp(swing.omega, joint.omega, joint.gain))
        for f in factor:
            size = (f * swing.amplitude * gain) ** np.arange(len(joint.rising))
            predicted.append(steady_loop(joint.rising * size, joint.falling * size).kind)
    omega, amplitude = np.array([s.omega for s in swings]), np.array([s.amplitude for s in swings])
    return Admissible(omega, amplitude, joint.kind, factor, tuple(predicted))


def one_sided(swings: Sequence[Swing], joint: JointLoops) -> Iterator[str]:
    """Say what the loops could not show."""
    index = [int(np.argmin(np.abs(joint.omega - s.omega))) for s in swings]
    sizes = [(s.amplitude * joint.gain[j]) ** np.arange(len(joint.rising)) for s, j in zip(swings, index, strict=True)]
    strict = [steady_loop(joint.rising * size, joint.falling * size).kind for size in sizes]
    if not joint.static and any(a != b for a, b in zip(strict, joint.kind, strict=True)):
        yield (
            "the borders meet where a sine turns, to noise: as fitted the loop may stick there; the borders are good, a "
            "simulation needs them apart by a hair"
        )
    if not joint.static and FULL not in joint.kind:
        yield "no sine meets both borders: the one that is not met is not known; try other amplitudes"
    elif part := sum(kind not in (FULL, "static") for kind in joint.kind):
        yield f"{part} sine{'s' * (part > 1)} met one border only, or none"
    if CONSTANT in joint.kind:
        yield "the fitted borders predict a constant output for a sine that moves: the fit may be wrong"


class ParametricLoops(NamedTuple):
    """Parametric loops: borders and G(s), G(0) = 1, fitted to all periods at once."""

    rising: Annotated[Floats, Quantity("output", ("power",), error="rising_std")]
    rising_std: Annotated[Floats, Quantity("output", ("power",))]
    falling: Annotated[Floats, Quantity("output", ("power",), error="falling_std")]
    falling_std: Annotated[Floats, Quantity("output", ("power",))]
    estimate: Estimate

    def table(self) -> Table:
        """Return one row a number."""
        e = self.estimate
        rows = tuple((n, Measured(float(v), float(s))) for n, v, s in zip(e.names, e.values, e.std, strict=True))
        return Table("Parametric fit", ("number", "value"), rows, (f"χ²/dof {e.chi2:.1f}/{e.dof}; static gain of G is 1",))


def parametric(swings: Sequence[Swing], joint: JointLoops, linear: TransferFunction) -> ParametricLoops:
    """Fit G(s) of the structure found, and the borders, to all averaged periods: min Σ ((w − mean)/std)²."""
    zeros, poles, delay = len(linear.num) - 1, len(linear.den) - 1, linear.delay > 0
    n = len(joint.rising)
    shift = float(np.mean(np.log(joint.gain) - _log_gain(linear, joint.omega)))
    shape = np.exp(shift) ** np.arange(n)
    gains = rational_gains(np.array([s.omega for s in swings]), zeros, poles, delay)
    start = [*linear.num[::-1][1:], *linear.den[::-1][1:], *([linear.delay] if delay else [])]
    names = [f"num.{k + 1}" for k in range(zeros)] + [f"den.{k + 1}" for k in range(poles)] + ["delay"] * delay
    free = [
        Parameter(name, float(v), "s", lower=0.0 if name[0] == "d" else -np.inf)
        for name, v in zip(names, start, strict=True)
    ]
    fit = LoopFit(swings, n - 1, gains, joint.static)
    found = fit.solve(joint.rising * shape, joint.falling * shape, free)
    own = n if joint.static else 2 * n
    rising, falling = fit.borders(found.values[:own])
    rising_std, falling_std = fit.borders(found.std[:own])
    return ParametricLoops(rising, rising_std, falling, falling_std, found)


def _log_gain(linear: TransferFunction, omega: Floats) -> Floats:
    s = 1j * omega
    return np.asarray(np.log(np.abs(np.polyval(linear.num, s) / np.polyval(linear.den, s))))


def model_of(found: ParametricLoops, linear: TransferFunction, *, static: bool, missing: tuple[str, ...]) -> Model:
    """Return linear block, delay if there is one, and the backlash (or curve); names are paths in that tree."""
    values = dict(zip(found.estimate.names, found.estimate.values.tolist(), strict=True))
    zeros, poles = len(linear.num) - 1, len(linear.den) - 1
    num = (*(values[f"num.{k}"] for k in range(zeros, 0, -1)), 1.0)
    den = (*(values[f"den.{k}"] for k in range(poles, 0, -1)), 1.0)
    chain: list[Block] = [Linear(num=num, den=den)]
    if "delay" in values:
        chain.append(Delay(seconds=values["delay"]))
    last = len(chain)
    rising, falling = (tuple(map(float, side)) for side in (found.rising, found.falling))
    chain.append(Polynomial(coefficients=rising) if static else Backlash(rising=rising, falling=falling))
    paths = {f"num.{k}": f"chain.0.num.{zeros - k}" for k in range(1, zeros + 1)}
    paths |= {f"den.{k}": f"chain.0.den.{poles - k}" for k in range(1, poles + 1)} | {"delay": "chain.1.seconds"}
    paths |= {f"curve.{k}": f"chain.{last}.coefficients.{k}" for k in range(len(rising))}
    names = tuple(paths.get(name, f"chain.{last}.{name}") for name in found.estimate.names)
    return Model(System(chain=tuple(chain)), found.estimate._replace(names=names), "unit_dc", missing)


def refined(model: Model, records: Sequence[Record]) -> tuple[Refined, Model]:
    """Fit every number to every sample; the static gain stays 1."""
    head = model.system.chain[0]
    assert isinstance(head, Linear)
    held = (f"chain.0.num.{len(head.num or ()) - 1}", f"chain.0.den.{len(head.den or ()) - 1}")
    whole = refine(model.system, records, fixed=held)
    if whole.estimate.why_stop == "interrupted":
        raise KeyboardInterrupt
    return whole, model._replace(system=whole.system, estimate=whole.estimate)
