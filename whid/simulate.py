"""A plant, an experiment and a random generator make a Record."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import tee

import numpy as np

from whid.blocks._block import Block, State
from whid.blocks.chain import Chain
from whid.disturbances._disturbance import Disturbance
from whid.errors import WhidError
from whid.experiments._experiment import Experiment
from whid.experiments._part import Part
from whid.long_record import LongRecord
from whid.predict import chunks, respond, respond_to, signals
from whid.record import CHUNK, Chunk, Record
from whid.signal import Floats, Panels, Signal, Spread, held
from whid.system import System


def simulate(
    system: System,
    experiment: Experiment,
    rng: np.random.Generator,
    plan: tuple[Part, ...] | None = None,
    clean: Clean | None = None,
) -> Record:
    """Return the record that the plant would give: y = chain(u) + noise.

    The generator is split into one stream for the input and one a disturbance, so that changing the size of one noise
    changes no other draw. `clean` keeps the undisturbed output for the next record with the same input.
    Raises `WhidError("block-no-steady-state")` for `initial: steady` of an integrating plant.

    >>> from whid.blocks.linear import Linear
    >>> from whid.experiments.hold import Hold
    >>> plant = System(chain=(Linear(num=(1.0,), den=(1.0, 1.0)),))
    >>> simulate(plant, Experiment(dt=1.0, parts=(Hold(level=1.0, hold_s=3.0),)), np.random.default_rng(0)).y.round(3)
    array([0.   , 0.632, 0.865])
    """
    plan = experiment.plan() if plan is None else plan
    input_rng, *noise_rngs = rng.spawn(1 + len(system.noise))
    clean = clean or Clean()
    u = clean.input(experiment, plan, input_rng)
    between = experiment.intersample if experiment.path == "exact" else "discrete"
    signal = held(u, experiment.dt, between, 0.0, system.tree.panel_order(experiment.dt))
    noises = list(zip(system.noise, noise_rngs, strict=True))
    inner = [pair for pair in noises if pair[0].place == "nonlinearity"]
    if inner:
        x = _disturbed(system, signal, experiment.initial, inner)
    else:
        x = clean.output(system.tree, signal, between, experiment.initial)
    y = x
    for noise, stream in noises:
        if noise.place == "output":
            y = y + noise.scale(x) * noise.shape(x, experiment.dt) * noise.draw(len(u), experiment.dt, stream)
    return Record(
        u=u, y=y, dt=experiment.dt, intersample=experiment.intersample, initial=experiment.initial,
        parts=plan, name=experiment.name,
    )  # fmt: skip


def stream(
    system: System, experiment: Experiment, rng: np.random.Generator, plan: tuple[Part, ...] | None = None
) -> LongRecord:
    """Return the record of `simulate`, number for number, that is simulated chunk by chunk whenever somebody reads it.

    A noise whose size is an SNR costs a pass more: first the undisturbed output's variance. Raises `WhidError("memory")`
    for what acts on a whole record: a band-limited input, a block that looks ahead, a noise that is drawn at once.
    """
    plan = experiment.plan() if plan is None else plan
    samples = plan[-1].stop or 0
    input_rng, *noise_rngs = rng.spawn(1 + len(system.noise))
    between = experiment.intersample if experiment.path == "exact" else "discrete"
    work = _Streamed(system, experiment, plan, input_rng, tuple(noise_rngs), between, samples)
    work.check()
    return LongRecord(
        samples=samples, read=work.read, dt=experiment.dt, intersample=experiment.intersample, initial=experiment.initial,
        parts=plan, name=experiment.name,
    )  # fmt: skip


@dataclass
class _Streamed:
    """A simulation that can be started again and again."""

    system: System
    experiment: Experiment
    plan: tuple[Part, ...]
    input_rng: np.random.Generator
    noise_rngs: tuple[np.random.Generator, ...]
    between: str
    samples: int
    scales: dict[int, float] = field(default_factory=dict)  # of the noises whose size is an SNR, by their number

    def check(self) -> None:
        """Raise for what cannot be done in chunks."""
        if self.between == "bandlimited":
            next(signals((), self.experiment.dt, self.between, 0.0, 1))
        if self.system.tree.looks_ahead():
            raise WhidError("memory", "a block of the plant looks ahead: its record is simulated as a whole, not in chunks")
        for noise in self.system.noise:
            if noise.stream(1, self.experiment.dt, np.random.default_rng(0)) is None:
                raise WhidError("memory", f"{noise.kind} noise is drawn for a whole record at once, not in chunks")
            if noise.place == "nonlinearity" and noise.std is None:
                raise WhidError("memory", f"{noise.kind} noise of a long record needs std: not snr_db")

    def read(self, outputs: bool = True) -> Iterator[Chunk]:
        """Yield the chunks of the record; without outputs the input only."""
        u = self.inputs()
        if not outputs:
            yield from (Chunk(start, u, u) for start, u in _numbered(u))
            return
        drawn = [(noise, self.scale(k), self.drawer(k)) for k, noise in enumerate(self.system.noise)
                 if noise.place == "output"]  # fmt: skip
        ahead, behind = tee(u)
        for (start, u_part), x in zip(_numbered(ahead), self.undisturbed(behind), strict=True):
            y = x
            for noise, scale, draw in drawn:
                y = y + scale * noise.shape(x, self.experiment.dt) * draw(len(x))
            yield Chunk(start, u_part, y)

    def inputs(self) -> Iterator[Floats]:
        """Yield u in chunks, the last one shorter."""
        rng, pending, size = copy.deepcopy(self.input_rng), [], 0
        for part in self.plan:
            made, first, last = part.stretch(self.experiment.dt, rng), 0, part.length
            while first < last:
                stop = min(last, first + CHUNK - size)
                pending.append(made(first, stop))
                size, first = size + stop - first, stop
                if size == CHUNK:
                    yield np.concatenate(pending) if len(pending) > 1 else pending[0]
                    pending, size = [], 0
        if size:
            yield np.concatenate(pending)

    def undisturbed(self, inputs: Iterable[Floats]) -> Iterator[Floats]:
        """Yield the output without the noise at the output."""
        system, experiment = self.system, self.experiment
        u = signals(inputs, experiment.dt, self.between, 0.0, system.tree.panel_order(experiment.dt))
        inner = [k for k, noise in enumerate(system.noise) if noise.place == "nonlinearity"]
        if not inner:
            yield from respond_to(system.tree, u, experiment.initial)
            return
        disturbed = _Disturbed(system, experiment.initial)
        draws = [(self.scale(k), self.drawer(k)) for k in inner]
        for signal in u:
            added = sum((scale * draw(signal.samples) for scale, draw in draws), np.zeros(signal.samples))
            yield disturbed.step(signal, added)

    def drawer(self, k: int) -> Callable[[int], Floats]:
        """Return what draws the next samples of a noise."""
        draw = self.system.noise[k].stream(self.samples, self.experiment.dt, copy.deepcopy(self.noise_rngs[k]))
        assert draw is not None
        return draw

    def scale(self, k: int) -> float:
        """Return the size of a noise, by a pass of its own where it is given as an SNR."""
        noise = self.system.noise[k]
        if noise.std is not None:
            return noise.std
        if k not in self.scales:
            spread = Spread()
            for x in self.undisturbed(self.inputs()):
                spread = spread.joined(Spread.of(x))
            self.scales[k] = spread.std * float(10 ** (-(noise.snr_db or 0.0) / 20))
        return self.scales[k]


class Clean:
    """The undisturbed outputs simulated last: repeats of a noisy experiment share one."""

    KEPT = 4

    def __init__(self) -> None:
        self.known: list[tuple[tuple[object, ...], Floats, Floats]] = []  # what else decides, input, output
        self.inputs: list[tuple[tuple[object, ...], Floats]] = []  # of plans without chance

    def input(self, experiment: Experiment, plan: tuple[Part, ...], rng: np.random.Generator) -> Floats:
        """Return the input of a plan: known, where none of its parts drew from the generator."""
        decides = (plan, experiment.dt)
        for known, u in self.inputs:
            if known == decides:
                return u
        before = rng.bit_generator.state
        u = experiment.input(plan, rng)
        if rng.bit_generator.state == before:
            self.inputs = [*self.inputs[1 - self.KEPT :], (decides, u)]
        return u

    def output(self, tree: Block, u: Signal, between: str, initial: str) -> Floats:
        """Return the tree's response to u (held between samples as named): known, or simulated now.

        >>> from whid.blocks.linear import Linear
        >>> clean, u = Clean(), Signal(np.ones(3), 1.0, between="zoh")
        >>> gain = Linear(num=(2.0,), den=(1.0,))
        >>> clean.output(gain, u, "zoh", "rest") is clean.output(gain, u, "zoh", "rest")
        True
        """
        decides = (tree, between, initial, u.dt, u.t0, u.order)
        for known, values, x in self.known:
            if known == decides and (values is u.values or np.array_equal(values, u.values)):
                return x
        x = respond(tree, u, initial)[0]
        self.known = [*self.known[1 - self.KEPT :], (decides, u.values, x)]
        return x


def _disturbed(system: System, u: Signal, initial: str, noises: list[tuple[Disturbance, np.random.Generator]]) -> Floats:
    """Return the output with noise, held between samples, added ahead of the first nonlinear block."""
    plant = _Disturbed(system, initial)
    v = respond(plant.front, u, initial)[0] if plant.front else u.values
    added = sum((n.scale(v) * n.draw(len(v), u.dt, rng) for n, rng in noises), np.zeros(len(v)))
    y = np.empty(len(v))
    for part in chunks(len(v), system.tree):
        y[part] = plant.step(u[part], added[part])
    return y


class _Disturbed:
    """A plant with an opening ahead of its first nonlinear block, stepped through chunk by chunk."""

    def __init__(self, system: System, initial: str) -> None:
        nonlinear = (i for i, block in enumerate(system.chain) if block.kind not in ("linear", "delay"))
        place = next(nonlinear, len(system.chain))
        self.front = Chain(chain=system.chain[:place]) if place else None
        self.back: Block = Chain(chain=system.chain[place:])
        self.initial = initial
        self.front_state: State = None
        self.back_state: State = None

    def step(self, u: Signal, added: Floats) -> Floats:
        """Return the next output samples."""
        if self.initial == "steady" and self.back_state is None:
            level = float(u.values[0])
            level, self.front_state = self.front.steady(level, u.dt) if self.front else (level, None)
            self.back_state = self.back.steady(level, u.dt)[1]
        inner, self.front_state = self.front.step(u, self.front_state) if self.front else (u, None)
        out, self.back_state = self.back.step(_plus(inner, added), self.back_state)
        return out.values


def _numbered(chunks: Iterable[Floats]) -> Iterator[tuple[int, Floats]]:
    """Yield chunks with the number of their first sample."""
    start = 0
    for chunk in chunks:
        yield start, chunk
        start += len(chunk)


def _plus(signal: Signal, noise: Floats) -> Signal:
    """Return the signal plus a held noise; its own course between samples stays."""
    if not callable(signal.between):
        return signal.with_values(signal.values + noise)
    inner = signal.between

    def between() -> Panels:
        panels = inner()
        s = panels.splits
        shifted = s._replace(values=s.values + noise[s.interval]) if len(s.interval) else s
        return panels._replace(values=panels.values + noise, splits=shifted)

    return signal.with_values(signal.values + noise, between)
