"""Statistics drawn as noisy records would give them, for studies that read nothing else: no record is made.

Of white Gaussian noise at the output the holds are drawn sample by sample (a noise model is estimated from them), the sines
as lines of their spectrum: value of a harmonic ~ N(x, 2σ²/N) in its real and in its imaginary part, each line beside it
alike about what the undisturbed output has there, and |all other lines|² together ~ non-central χ². Every line is drawn
once: what two errors share in a record they share here. The distribution of all that is read is that of records, exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from whid.disturbances._disturbance import Disturbance
from whid.experiments._experiment import Experiment
from whid.methods import _visits
from whid.methods._sines import Drive, Sine, drives
from whid.methods._statistics import OfRecords, OfVisits
from whid.record import Record
from whid.signal import Floats
from whid.simulate import simulate
from whid.stages.periods import Complexes, Harmonics, Window, of_lines
from whid.system import System

PLANS = 4  # undisturbed records that are kept
SURE = 12.0  # standard errors: a harmonic so large stands out of the noise in every repeat, 5 being asked


@dataclass(frozen=True, eq=False)
class Drawn(OfVisits):
    """Levels and harmonics of one repeat (see `Statistics`); asked twice it says the same."""

    plans: Sequence[Quiet]
    std: Sequence[float]
    seeds: Sequence[np.random.SeedSequence]
    sampled: bool = False

    @property
    def records(self) -> Sequence[Record]:
        """Return the records as nobody measured them: input and parts, no output."""
        return [plan.unmeasured for plan in self.plans]

    @property
    def samples(self) -> int:
        """Return the number of samples for estimation."""
        return sum(int(plan.record.using("estimation").sum()) for plan in self.plans)

    def joined(self, more: Sequence[Record]) -> OfRecords:
        """Return the statistics of measured records beside what has none: a plan that asks for more is not drawn."""
        return OfRecords([*self.records, *more])

    def sines(self, settle: float, highest: int, colour: Mapping[float, Floats]) -> list[Sine]:
        """Return the sines and their harmonics."""
        found = []
        for plan, std, (_, rng) in self._streams():
            ar = colour.get(plan.record.dt, np.empty(0))
            for spectrum in plan.spectra(settle, highest):
                drive = spectrum.drive
                found.append(Sine(drive.omega, drive.offset, drive.phasor, spectrum.draw(std, rng, ar)))
        return found

    def visits(self) -> list[_visits.Visit]:
        """Return every visit of a level with samples as they would be measured."""
        every = []
        for plan, std, (rng, _) in self._streams():
            every += [v._replace(y=v.y + std * rng.standard_normal(len(v.y))) for v in _visits.visits([plan.record])]
        return every

    def _streams(self) -> Iterator[tuple[Quiet, float, tuple[np.random.Generator, np.random.Generator]]]:
        """Yield every plan with its noise and generators of its own, for holds and sines, from their beginning."""
        for plan, std, seed in zip(self.plans, self.std, self.seeds, strict=True):
            keys = ((*seed.spawn_key, k) for k in range(2))  # not `spawn`, which would go on from the last call
            holds, sines = (np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=key)) for key in keys)
            yield plan, std, (holds, sines)


@dataclass(frozen=True, eq=False)
class Quiet:
    """The undisturbed record of one experiment: what its repeats share."""

    record: Record

    @cached_property
    def unmeasured(self) -> Record:
        """Return it without its output."""
        nothing, never = np.broadcast_to(np.nan, len(self.record)), np.broadcast_to(False, len(self.record))
        return replace(self.record, y=nothing, valid=never)

    @lru_cache(maxsize=PLANS)  # noqa: B019
    def spectra(self, settle: float, highest: int) -> tuple[Spectrum, ...]:
        """Return every sine's spectrum, as far as a method that reads harmonics to the highest looks at it."""
        return tuple(Spectrum.of(self.record.y, drive, highest) for drive in drives(self.record, settle))

    def std(self, noise: Sequence[Disturbance]) -> float:
        """Return the standard deviation of white noises together."""
        return float(np.sqrt(sum(each.scale(self.record.y) ** 2 for each in noise)))


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Spectrum of a sine's undisturbed output where it is looked at, and of the rest its power."""

    drive: Drive
    window: Window
    count: int  # harmonics
    lines: NDArray[np.intp]  # (L,) those that are drawn one by one
    undisturbed: Complexes  # (L,)
    other_lines: int  # between harmonics; never the last line, which is real
    other_power: float

    @classmethod
    def of(cls, y: Floats, drive: Drive, highest: int) -> Spectrum:
        """Return the spectrum of the whole periods of a sine in an undisturbed output."""
        period = round(drive.period)
        measured = y[drive.part][drive.skip * period :]
        periods = len(measured) // period
        spectrum = np.fft.rfft(measured[: periods * period])
        n = periods * period
        count, window = min(highest, drive.highest, (period + 1) // 2 - 1), Window(drive.period, periods, n, n)
        beside = [window.lines(count), window.lines(count, 0), np.arange(count + 1) * periods, np.array([n // 2])]
        lines = np.unique(np.concatenate([part.ravel() for part in beside]))
        other = np.arange(len(spectrum)) % periods != 0
        other[lines] = False
        rest = float(np.sum(np.abs(spectrum[other]) ** 2))
        return cls(drive, window, count, lines, spectrum[lines], int(other.sum()), rest)

    def draw(self, std: float, rng: np.random.Generator, ar: Floats) -> Harmonics:
        """Return the harmonics and errors that a record with white noise of that standard deviation gives."""
        n = self.window.length
        size = std * np.sqrt(n / 2)
        drawn = size * rng.standard_normal((2, len(self.lines)))
        real = (self.lines == 0) | (2 * self.lines == n)
        noise = np.where(real, np.sqrt(2) * drawn[0], drawn[0] + 1j * drawn[1])
        rest = self.other_power
        if size and self.other_lines:
            rest = size**2 * rng.noncentral_chisquare(2 * self.other_lines, self.other_power / size**2)
        return self.read(self.undisturbed + noise, rest, ar)

    def read(self, seen: Complexes, other_power: float, ar: Floats) -> Harmonics:
        """Return the harmonics and errors of a disturbed spectrum: its lines, and the power of the others together."""
        n, periods = self.window.length, self.window.periods
        power, between = np.zeros(n // 2 + 1), self.lines % periods != 0
        power[self.lines] = np.abs(seen) ** 2
        total = other_power + power[self.lines[between]].sum()
        level = float(np.sqrt(total / (self.other_lines + between.sum()) / n))
        value = seen[np.searchsorted(self.lines, np.arange(self.count + 1) * periods)] * 2 / n
        value[0] /= 2
        return of_lines(value, power, level, self.window, ar)

    def stands_out(self, std: float) -> bool:
        """Tell whether a harmonic stands out of the noise whatever the draw."""
        n = self.window.length
        value = np.abs(self.undisturbed[np.isin(self.lines, np.arange(1, self.count + 1) * self.window.periods)]) * 2 / n
        return bool(value.max(initial=0.0) > SURE * std * np.sqrt(2 / n))


@lru_cache(maxsize=PLANS)
def quiet(plant: System, experiment: Experiment) -> Quiet:
    """Return the undisturbed record of a plant without noise; the last few are kept."""
    return Quiet(simulate(plant, experiment, np.random.default_rng(0)))


def plans(plant: System, experiments: Sequence[Experiment]) -> list[Quiet]:
    """Return the undisturbed records of a study's experiments."""
    silent = replace(plant, noise=())
    return [quiet(silent, experiment) for experiment in experiments]


def refusal(plant: System, experiments: Sequence[Experiment], settle: float, highest: int) -> str:
    """Return why statistics of these experiments cannot be drawn, "" where they can."""
    return _of_noise(plant) or _of_parts(experiments) or _of_sines(plant, experiments, settle, highest)


def _of_noise(plant: System) -> str:
    if not plant.noise:
        return "without noise there is nothing to draw"
    other = next((noise for noise in plant.noise if noise.kind != "white"), None)
    if other is None:
        return ""
    where = "at the output" if other.place == "output" else "ahead of the nonlinearity"
    return f"the noise is not white at the output: `{other.kind}` {where}"


def _of_parts(experiments: Sequence[Experiment]) -> str:
    for experiment in experiments:
        if experiment.adaptive is not None:
            return "`adaptive:` lets the method ask for more, which is a record"
        for part in experiment.plan():
            if part.kind not in ("hold", "sine"):
                return f"a part of kind `{part.kind}` has no levels or harmonics"
            if part.use != "estimation":
                return f"a part for {part.use} is scored sample by sample"
            period = getattr(part, "period", 1.0)
            if abs(period - round(period)) > 1e-9 * period:
                return f"a sine of {period:.6g} samples a period: give it a whole number (`samples_per_period:`)"
    return ""


def _of_sines(plant: System, experiments: Sequence[Experiment], settle: float, highest: int) -> str:
    for plan in plans(plant, experiments):
        std = plan.std(plant.noise)
        if any(spectrum.stands_out(std) for spectrum in plan.spectra(settle, highest)):
            return ""
    return "no sine is sure to stand out of the noise; without one the steps between levels are read sample by sample"
