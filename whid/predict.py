"""The response of a tree of blocks to an input, streamed in chunks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from whid.blocks._block import Block, State
from whid.record import Record
from whid.signal import Floats, Signal, held

CHUNK = 1 << 15  # samples: the panels of a chunk stay in the cache


def respond(tree: Block, u: Signal, initial: str = "rest", state: State = None) -> tuple[Floats, State]:
    """Return the output samples of a tree and its last state.

    u a signal of any length; initial: rest, or steady at u's first sample (free: the given state, else steady).
    Raises `WhidError("block-no-steady-state")`.
    """
    if state is None and initial != "rest" and len(u.values):
        state = tree.steady(float(u.values[0]), u.dt)[1]
    y = np.empty(len(u.values))
    for part in chunks(len(u.values)):
        out, state = tree.step(u[part], state)
        y[part] = out.values
    return y, state


def predict(tree: Block, record: Record, path: str = "exact") -> Floats:
    """Return ŷ of a record: the model driven by the record's input, as it is declared between samples.

    >>> from whid.blocks.linear import Linear
    >>> predict(Linear(num=(2.0,), den=(1.0, 1.0)), Record(u=np.ones(3), y=np.zeros(3), dt=1.0, initial="steady"))
    array([2., 2., 2.])
    """
    return respond(tree, input_signal(tree, record, path), record.initial)[0]


def input_signal(tree: Block, record: Record, path: str = "exact") -> Signal:
    """Return the record's input with its declared course between samples, ready for this tree."""
    between = record.intersample if path == "exact" else "discrete"
    return held(record.u, record.dt, between, record.t0, tree.panel_order(record.dt))


def chunks(samples: int) -> Iterator[slice]:
    """Yield slices that cover a record."""
    return (slice(start, min(start + CHUNK, samples)) for start in range(0, samples, CHUNK))
