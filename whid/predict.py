"""The response of a tree of blocks to an input, streamed in chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from whid.blocks._block import Block, State
from whid.errors import WhidError
from whid.fit import Parameter, least_squares
from whid.record import CHUNK, Record
from whid.signal import Floats, Signal, held


def respond(tree: Block, u: Signal, initial: str = "rest", state: State = None) -> tuple[Floats, State]:
    """Return the output samples of a tree and its last state.

    u a signal of any length; initial: rest, or steady at u's first sample (free: the given state, else steady).
    Raises `WhidError("block-no-steady-state")`.
    """
    if state is None and initial != "rest" and len(u.values):
        state = tree.steady(float(u.values[0]), u.dt)[1]
    y = np.empty(len(u.values))
    for part in chunks(len(u.values), tree):
        out, state = tree.step(u[part], state)
        y[part] = out.values
    return y, state


def respond_to(tree: Block, inputs: Iterable[Signal], initial: str = "rest", state: State = None) -> Iterator[Floats]:
    """Yield the output samples of a tree to an input in chunks, as `respond` does for a whole one."""
    for u in inputs:
        if state is None and initial != "rest":
            state = tree.steady(float(u.values[0]), u.dt)[1]
        out, state = tree.step(u, state)
        yield out.values


def signals(inputs: Iterable[Floats], dt: float, intersample: str, t0: float, order: int) -> Iterator[Signal]:
    """Yield an input in chunks as signals; straight lines (foh) reach for the first sample of the next chunk.

    Raises `WhidError("memory")` for a band-limited input: what it does between two samples hangs on all.
    """
    if intersample == "bandlimited":
        raise WhidError("memory", "a band-limited input is interpolated as a whole: not in chunks", "intersample")
    if intersample != "foh":
        start = 0
        for u in inputs:
            yield held(u, dt, intersample, t0 + start * dt, order)
            start += len(u)
        return
    start, last = 0, np.empty(0)
    for u in inputs:
        if len(last):
            yield held(np.append(last, u[:1]), dt, intersample, t0 + start * dt, order)[: len(last)]
            start += len(last)
        last = u
    yield held(last, dt, intersample, t0 + start * dt, order)


def predict(tree: Block, record: Record, path: str = "exact") -> Floats:
    """Return ŷ of a record: the model driven by the record's input, as it is declared between samples.

    With `initial: free` the state before the first sample is fitted to the record's own output (`free_state`).

    >>> from whid.blocks.linear import Linear
    >>> predict(Linear(num=(2.0,), den=(1.0, 1.0)), Record(u=np.ones(3), y=np.zeros(3), dt=1.0, initial="steady"))
    array([2., 2., 2.])
    """
    u = input_signal(tree, record, path)
    state = free_state(tree, u, record) if record.initial == "free" else None
    return respond(tree, u, record.initial, state)[0]


def free_state(tree: Block, u: Signal, record: Record, horizon: int = 20_000) -> State:
    """Return the initial state that explains a record's first samples best, from the steady state of its first input.

    min Σ (y − ŷ(x₀))² over the numbers in the tree's state, by differences (a state has few). What the output does not
    show keeps its start. Rest where the tree has no steady state. Report samples have no part in it, where there are others.
    """
    try:
        start = tree.steady(float(u.values[0]), u.dt)[1]
    except WhidError:
        start = tree.step(u[:0])[1]
    numbers, rebuild = _flattened(start)
    head = u[: min(horizon, len(record))]
    closed = (record.mask & ~record.using("report"))[:horizon]
    known = closed if closed.any() else record.mask[:horizon]

    def residual(x: Floats) -> Floats:
        return np.asarray((respond(tree, head, state=rebuild(x))[0] - record.y[: len(head.values)])[known])

    def tangent(x: Floats) -> Floats:
        steps = 1e-6 * np.maximum(np.abs(numbers), np.abs(numbers).max(initial=1e-3))
        return np.stack([(residual(x + d) - residual(x - d)) / (2 * d.sum()) for d in np.diag(steps)], axis=1)

    if not len(numbers) or not known.any():
        return start
    estimate = least_squares(residual, tangent, [Parameter(f"x.{k}", v) for k, v in enumerate(numbers)], tolerance=1e-4)
    return rebuild(estimate.values)


def _flattened(state: State) -> tuple[Floats, Callable[[Floats], State]]:
    """Return the numbers in a state's arrays, however nested, and the way back."""
    if isinstance(state, (list, tuple)):
        inner = [_flattened(item) for item in state]
        ends = np.cumsum([len(numbers) for numbers, _ in inner])[:-1]
        back = [way for _, way in inner]
        return (
            np.concatenate([numbers for numbers, _ in inner]) if inner else np.empty(0),
            lambda x: getattr(state, "_make", type(state))(
                [way(part) for way, part in zip(back, np.split(x, ends), strict=True)]
            ),
        )
    if isinstance(state, np.ndarray) and state.dtype.kind in "fc":
        if state.dtype.kind == "c":
            n = state.size
            return np.concatenate([state.real.ravel(), state.imag.ravel()]), lambda x: (x[:n] + 1j * x[n:]).reshape(
                state.shape
            )
        return state.ravel().astype(float), lambda x: x.reshape(state.shape)
    return np.empty(0), lambda x: state


def input_signal(tree: Block, record: Record, path: str = "exact") -> Signal:
    """Return the record's input with its declared course between samples, ready for this tree."""
    between = record.intersample if path == "exact" else "discrete"
    return held(record.u, record.dt, between, record.t0, tree.panel_order(record.dt))


def chunks(samples: int, tree: Block | None = None, size: int = CHUNK) -> Iterator[slice]:
    """Yield slices that cover a record: one, where a block of the tree looks ahead."""
    size = max(samples, 1) if tree is not None and tree.looks_ahead() else size
    return (slice(start, min(start + size, samples)) for start in range(0, samples, size))
