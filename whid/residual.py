"""What a model leaves unexplained."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import tee
from typing import NamedTuple

import numpy as np

from whid.blocks._block import Block, State
from whid.errors import WhidError
from whid.experiments._part import Use
from whid.experiments.steps import Steps
from whid.long_record import LongRecord, Thinned
from whid.predict import free_state, input_signal, predict, respond_to, signals
from whid.record import Chunk, Record, used
from whid.signal import Floats, Spread

USES: tuple[Use, ...] = ("estimation", "selection", "report")
KEPT = 100_000  # samples of a long record that are kept for pictures


class Residual(NamedTuple):
    """A record, what a model predicts of it, and what is left: y − ŷ, NaN where y is missing."""

    record: Record
    predicted: Floats
    error: Floats


def explain(tree: Block, record: Record, path: str = "exact") -> Residual:
    """Return prediction and residual of a record."""
    predicted = predict(tree, record, path)
    return Residual(record, predicted, np.where(record.mask, record.y - predicted, np.nan))


def residual(tree: Block, record: Record, path: str = "exact") -> Floats:
    """Return y − ŷ of a record, NaN where y is missing.

    >>> from whid.blocks.linear import Linear
    >>> gain = Linear(num=(2.0,), den=(1.0,))
    >>> residual(gain, Record(u=np.ones(2), y=np.array([2.5, np.nan]), dt=1.0))
    array([0.5, nan])
    """
    return explain(tree, record, path).error


class Size(NamedTuple):
    """How large residual and output are over the samples of one use."""

    samples: int
    errors: int  # that are known
    square: float  # Σ (y − ŷ)²
    output: Spread

    @classmethod
    def of(cls, error: Floats, output: Floats) -> Size:
        """Return that of samples that are all here."""
        finite = error[np.isfinite(error)]
        return cls(len(error), len(finite), float(finite @ finite), Spread.of(output))

    def joined(self, other: Size) -> Size:
        """Return that of two stretches of a record together."""
        counts = self.samples + other.samples, self.errors + other.errors, self.square + other.square
        return Size(*counts, self.output.joined(other.output))


class Misfit(NamedTuple):
    """What a model leaves over of a record: its size by use, the range of the input, and samples to look at."""

    sizes: Mapping[str, Size]
    reach: tuple[float, float]
    record: Record  # of a long record every so many-th sample
    error: Floats  # of `record`


def misfit(tree: Block, record: Record | LongRecord, path: str = "exact") -> Misfit:
    """Return how large the residual of a record is, in one pass over one that is too long for memory.

    Raises `WhidError("memory")` where the model acts on whole records only.
    """
    if isinstance(record, LongRecord):
        return _streamed(tree, record, path)
    return misfit_of(record, residual(tree, record, path))


def misfit_of(record: Record, error: Floats) -> Misfit:
    """Return the same of a residual that is known.

    >>> misfit_of(Record(u=np.ones(2), y=np.array([2.0, 4.0]), dt=1.0), np.array([3.0, 4.0])).sizes["estimation"].square
    25.0
    """
    sizes: dict[str, Size] = {use: Size.of(error[on], record.y[on]) for use in USES if (on := record.using(use)).any()}
    return Misfit(sizes, (float(record.u.min()), float(record.u.max())), record, error)


def _streamed(tree: Block, record: LongRecord, path: str) -> Misfit:
    if tree.looks_ahead():
        raise WhidError("memory", f"a block of the model looks ahead: record {record.name} is too long for it")
    state: State = None
    sizes: dict[str, Size] = dict.fromkeys(USES, Size(0, 0, 0.0, Spread()))
    if record.initial == "free":
        head = record.head(20_000)
        state = free_state(tree, input_signal(tree, head, path), head)
    kept, errors = Thinner(record), []
    ahead, behind = tee(record.chunks())
    between = record.intersample if path == "exact" else "discrete"
    inputs = signals((chunk.u for chunk in behind), record.dt, between, record.t0, tree.panel_order(record.dt))
    for chunk, y_hat in zip(ahead, respond_to(tree, inputs, record.initial, state), strict=True):
        error = chunk.y - y_hat
        for use in USES:
            on = used(record, chunk, use)
            if on.any():
                sizes[use] = sizes[use].joined(Size.of(error[on], chunk.y[on]))
        kept.add(chunk)
        errors.append(error[kept.of(chunk)].copy())  # a view would keep the chunk
    reached: dict[str, Size] = {use: size for use, size in sizes.items() if size.samples}
    return Misfit(reached, kept.reach, kept.record(), np.concatenate(errors))


class Thinner:
    """Keeps every so many-th sample of a long record whose chunks pass by, and the range of the input."""

    def __init__(self, record: LongRecord) -> None:
        self.long, self.every = record, -(-len(record) // KEPT)
        self.some: list[Floats] = []
        self.reach = (np.inf, -np.inf)

    def of(self, chunk: Chunk) -> slice:
        """Return which samples of a chunk are kept."""
        return slice(-chunk.start % self.every, None, self.every)

    def add(self, chunk: Chunk) -> None:
        """Keep some of a chunk."""
        kept = self.of(chunk)
        self.some.append(np.stack([chunk.u[kept], chunk.y[kept]]))
        self.reach = min(self.reach[0], float(chunk.u.min())), max(self.reach[1], float(chunk.u.max()))

    def record(self) -> Thinned:
        """Return what was kept; what a part was is not to be seen in it, what it was for is."""
        (u, y), every, long = np.concatenate(self.some, axis=1), self.every, self.long
        at = (Steps(start=-(-(p.start or 0) // every), stop=-(-(p.stop or 1) // every), use=p.use) for p in long.parts)
        parts = tuple(part for part in at if part.length > 0)
        known = np.isfinite(y)
        return Thinned(
            u, y, long.dt * every, long.t0, None if known.all() else known, long.units, long.intersample,
            long.initial, parts, long.name, long.use, every=every, samples=len(long), was=long.parts,
        )  # fmt: skip


def thinned(record: LongRecord) -> Thinned:
    """Return every so many-th sample."""
    kept = Thinner(record)
    for chunk in record.chunks():
        kept.add(chunk)
    return kept.record()
