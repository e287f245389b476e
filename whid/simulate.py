"""A plant, an experiment and a random generator make a Record."""

from __future__ import annotations

import numpy as np

from whid.blocks._block import Block
from whid.blocks.chain import Chain
from whid.disturbances._disturbance import Disturbance
from whid.experiments._experiment import Experiment
from whid.experiments._part import Part
from whid.predict import chunks, respond
from whid.record import Record
from whid.signal import Floats, Panels, Signal, held
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
    u = experiment.input(plan, input_rng)
    between = experiment.intersample if experiment.path == "exact" else "discrete"
    signal = held(u, experiment.dt, between, 0.0, system.tree.panel_order(experiment.dt))
    noises = list(zip(system.noise, noise_rngs, strict=True))
    inner = [pair for pair in noises if pair[0].place == "nonlinearity"]
    if inner:
        x = _disturbed(system, signal, experiment.initial, inner)
    else:
        x = (clean or Clean()).output(system.tree, signal, between, experiment.initial)
    y = x
    for noise, stream in noises:
        if noise.place == "output":
            y = y + noise.scale(x) * noise.shape(x, experiment.dt) * noise.draw(len(u), experiment.dt, stream)
    return Record(
        u=u, y=y, dt=experiment.dt, intersample=experiment.intersample, initial=experiment.initial,
        parts=plan, name=experiment.name,
    )  # fmt: skip


class Clean:
    """The undisturbed outputs simulated last: repeats of a noisy experiment share one."""

    KEPT = 4

    def __init__(self) -> None:
        self.known: list[tuple[tuple[object, ...], Floats, Floats]] = []  # what else decides, input, output

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
            if known == decides and np.array_equal(values, u.values):
                return x
        x = respond(tree, u, initial)[0]
        self.known = [*self.known[1 - self.KEPT :], (decides, u.values, x)]
        return x


def _disturbed(system: System, u: Signal, initial: str, noises: list[tuple[Disturbance, np.random.Generator]]) -> Floats:
    """Return the output with noise, held between samples, added ahead of the first nonlinear block."""
    place = next((i for i, block in enumerate(system.chain) if block.kind not in ("linear", "delay")), len(system.chain))
    front = Chain(chain=system.chain[:place]) if place else None
    v = respond(front, u, initial)[0] if front else u.values
    added = sum((n.scale(v) * n.draw(len(v), u.dt, rng) for n, rng in noises), np.zeros(len(v)))
    back: Block = Chain(chain=system.chain[place:])
    front_state = back_state = None
    if initial == "steady":
        level, front_state = front.steady(float(u.values[0]), u.dt) if front else (float(u.values[0]), None)
        back_state = back.steady(level, u.dt)[1]
    y = np.empty(len(v))
    for part in chunks(len(v), system.tree):
        inner, front_state = front.step(u[part], front_state) if front else (u[part], None)
        out, back_state = back.step(_plus(inner, added[part]), back_state)
        y[part] = out.values
    return y


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
