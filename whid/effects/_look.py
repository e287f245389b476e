"""What an effect sees: a fitted model, what it leaves over on the estimation data, and what its own numbers could absorb."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from whid.blocks._block import STEADY, Block
from whid.blocks.chain import Chain
from whid.blocks.feedback import Feedback
from whid.blocks.oversampled import Oversampled
from whid.effects._candidate import Candidate
from whid.errors import WhidError
from whid.predict import chunks, input_signal
from whid.record import Record
from whid.refine import Past, past
from whid.refine._free import walk
from whid.signal import Floats, Signal
from whid.stages._whiten import whitened
from whid.system import System

Bools = NDArray[np.bool_]
ROUNDING = 1e-9  # of a column: what is left of one that the model's numbers absorb whole
RANK = 1e-8  # of the largest singular value of the sensitivities, columns of unit length


@dataclass(frozen=True, eq=False)
class Noise:
    """What is known of one record's noise: σ of its innovation, and its colour e(t) = Σ aₖ e(t − k) + innovation.

    shape (N,) factors of σ where it varies from sample to sample, or None.
    """

    std: float = 1.0
    ar: tuple[float, ...] = ()
    shape: Floats | None = None


@dataclass(frozen=True, eq=False)
class Look:
    """A model before a set of records.

    records  as the fit sees them: selection and report samples hidden
    noises   one a record; every comparison is made on whitened rows over σ
    core     where in the system's series the declared blocks are
    path     exact between samples, or sampled
    """

    system: System
    records: tuple[Record, ...]
    noises: tuple[Noise, ...]
    core: tuple[int, int] = (0, 0)
    path: str = "exact"
    _courses: dict[int, tuple[Signal, ...]] = field(default_factory=dict)

    @cached_property
    def use(self) -> tuple[Bools, ...]:
        """Return where the samples of every record count."""
        return tuple(r.using("estimation") & np.isfinite(r.y) for r in self.records)

    @cached_property
    def samples(self) -> int:
        """Return how many samples count."""
        return sum(int(use.sum()) for use in self.use)

    @cached_property
    def rates(self) -> str:
        """Return the path of derivatives: those of a loop in continuous time are taken on samples: near, and cheap."""
        return "sampled" if any(isinstance(b, Feedback) and b.relaxes for _, b in walk(self.system.tree)) else self.path

    @cached_property
    def predicted(self) -> tuple[Floats, ...]:
        """Return ŷ of every record; where its derivatives are not known already, without them, which is cheaper."""
        if "_linearised" in self.__dict__ and self.rates == self.path:
            return self._linearised[0]
        pairs = zip(self.records, self.past, strict=True)
        return tuple(respond(self.system.tree, record, self.path, before) for record, before in pairs)

    @cached_property
    def errors(self) -> tuple[Floats, ...]:
        """Return y − ŷ of every record, NaN where it does not count."""
        pairs = zip(self.records, self.predicted, self.use, strict=True)
        return tuple(np.where(use, r.y - p, np.nan) for r, p, use in pairs)

    @cached_property
    def left(self) -> Floats:
        """Return the whitened residual over σ, (n,), without what the model's free numbers could still absorb."""
        return self.rest(self.rows([e[:, None] for e in self.errors]))[:, 0]

    @property
    def chi2(self) -> float:
        """Return Σ left²."""
        return float(self.left @ self.left)

    def rows(self, columns: Sequence[Floats]) -> Floats:
        """Return columns (N, q), one array a record, whitened, over σ, at the samples that count: (n, q)."""
        found = []
        for values, use, noise in zip(columns, self.use, self.noises, strict=True):
            white = whitened(np.where(use[:, None], values, 0.0), use, np.array(noise.ar))
            size = noise.std if noise.shape is None else noise.std * noise.shape[use][:, None]
            found.append(white[use] / size)
        return np.concatenate(found)

    def rest(self, rows: Floats) -> Floats:
        """Return rows without what changes of the model's free numbers could make, to first order."""
        q = self.basis
        left = np.asarray(rows - q @ (q.T @ rows))
        left[:, np.linalg.norm(left, axis=0) <= ROUNDING * np.linalg.norm(rows, axis=0)] = 0.0
        return left

    def simulate(self, system: System) -> tuple[Floats, ...] | None:
        """Return the response of another system to every record's input, None where it has none.

        Blocks that both systems begin with are not simulated again.
        """
        same = self._same(system)
        rest = Chain(chain=system.chain[same:]) if same < len(system.chain) else None
        try:
            found = tuple(
                (x.values if rest is None else rest.step(x, begun(rest, x, record))[0].values)[before.lead :]
                for record, x, before in zip(self.records, self.courses(same), self.past, strict=True)
            )
        except (WhidError, ValueError, np.linalg.LinAlgError, OverflowError):
            return None
        return found if all(np.all(np.isfinite(y)) for y in found) else None

    def change(self, system: System) -> Floats | None:
        """Return what another system would change of ŷ, whitened and projected, (n, 1); None where it has no response."""
        response = self.simulate(system)
        if response is None:
            return None
        columns = [(y - base)[:, None] for y, base in zip(response, self.predicted, strict=True)]
        return self.rest(self.rows(columns))

    def along(self, candidate: Candidate) -> Floats | None:
        """Return what a candidate's amplitudes would change of ŷ, each a unit of it, to first order from 0: (n, q)."""
        system = candidate.at(dict.fromkeys(candidate.amplitude, 0.0)).system
        same = self._same(system)
        rest = Chain(chain=system.chain[same:])
        names = [_shifted(name, same) for name in candidate.amplitude]
        found = []
        try:
            for record, x, before in zip(self.records, self.courses(same), self.past, strict=True):
                _, tangents, _ = rest.tangent(x, [], names, begun(rest, x, record))
                found.append(np.array([t.values[before.lead :] for t in tangents]).T)
        except (WhidError, ValueError, np.linalg.LinAlgError, OverflowError):
            return None
        return self.rest(self.rows(found)) if all(np.all(np.isfinite(j)) for j in found) else None

    @cached_property
    def past(self) -> tuple[Past, ...]:
        """Return what stands for every record's past: held levels that explain it best, none unless its state is free."""
        return tuple(past(self.system.tree, record, self.path) for record in self.records)

    def courses(self, place: int) -> tuple[Signal, ...]:
        """Return what enters the block at a place of the system's own chain, its course between samples with it.

        What stands for an unknown past comes first (`past[k].lead` samples).
        """
        if place not in self._courses:
            found = []
            for record, before in zip(self.records, self.past, strict=True):
                u = before.joined(input_signal(self.system.tree, record, self.path))
                head = Chain(chain=self.system.chain[:place]) if place else None
                found.append(u if head is None else head.step(u, begun(head, u, record))[0])
            self._courses[place] = tuple(found)
        return self._courses[place]

    def signal(self, place: int) -> tuple[Floats, ...]:
        """Return the samples of what enters the block at a place of the series (len: what leaves the last)."""
        if self.system.series_path == "chain.":
            return tuple(x.values[before.lead :] for x, before in zip(self.courses(place), self.past, strict=True))
        blocks, whole = self.system.series[:place], self.system.chain[0]
        head: Block = (
            replace(whole, chain=blocks) if isinstance(whole, Oversampled) and blocks else Chain(chain=blocks or (whole,))
        )
        if not blocks:
            return tuple(np.asarray(r.u, float) for r in self.records)
        return tuple(respond(head, r, self.path, before) for r, before in zip(self.records, self.past, strict=True))

    def _same(self, system: System) -> int:
        """Return with how many blocks of this look's chain another one begins."""
        same = 0
        for mine, other in zip(self.system.chain, system.chain, strict=False):
            if mine is not other and mine != other:
                break
            same += 1
        return same

    def quantiles(self, place: int, shares: Sequence[float]) -> Floats:
        """Return quantiles of what enters the block at a place, at the samples that count."""
        every = np.concatenate([v[use] for v, use in zip(self.signal(place), self.use, strict=True)])
        return np.asarray(np.quantile(every, shares))

    @cached_property
    def _linearised(self) -> tuple[tuple[Floats, ...], Floats, tuple[Floats, ...]]:
        names = [p.name for p in self.system.tree.parameters()]
        pairs = [
            sensitivities(self.system.tree, record, names, self.rates, before)
            for record, before in zip(self.records, self.past, strict=True)
        ]
        return tuple(y for y, _ in pairs), self.rows([j for _, j in pairs]), tuple(j for _, j in pairs)

    def sensitivity(self, record: int) -> Floats:
        """Return the derivatives of one record's ŷ with respect to the model's free numbers, (N, p)."""
        return self._linearised[2][record]

    @cached_property
    def basis(self) -> Floats:
        """Return orthonormal columns that span the sensitivities, (n, rank)."""
        j = self._linearised[1]
        size = np.linalg.norm(j, axis=0)
        scaled = j[:, size > 0] / size[size > 0]
        values, vectors = np.linalg.eigh(scaled.T @ scaled)
        kept = values > RANK**2 * max(values.max(initial=0.0), 1e-300)
        if not kept.any():
            return np.zeros((len(j), 0))
        q = scaled @ (vectors[:, kept] / np.sqrt(values[kept]))
        return np.asarray(np.linalg.qr(q)[0])

    @cached_property
    def sampled(self) -> Look:
        """Return the look whose candidates are simulated on samples alone, against the same residual: a tenth of the cost.

        A change of ŷ is the difference of two responses on that path: right to a per cent where nothing is added that acts
        within a sample.
        """
        return self if self.path == "sampled" else _Sampled(self.system, self.records, self.noises, self.core, whole=self)

    def moved(self, system: System, core: tuple[int, int] | None = None) -> Look:
        """Return the look at another system."""
        return replace(self, system=system, core=self.core if core is None else core, _courses={})

    def span(self, place: int) -> tuple[float, float]:
        """Return the least and the greatest of what enters the block at a place."""
        low, high = self.quantiles(place, (0.0, 1.0))
        return float(low), float(high)


@dataclass(frozen=True, eq=False)
class _Sampled(Look):
    """A look on the sampled path that keeps residual and sensitivities of the whole one."""

    path: str = "sampled"
    whole: Look = field(kw_only=True)

    @property
    def errors(self) -> tuple[Floats, ...]:
        return self.whole.errors

    @property
    def left(self) -> Floats:
        return self.whole.left

    @property
    def basis(self) -> Floats:
        return self.whole.basis

    @property
    def past(self) -> tuple[Past, ...]:
        return self.whole.past


def _shifted(name: str, by: int) -> str:
    """Return the name of a number in a chain whose first blocks are gone."""
    _, place, rest = name.split(".", 2)
    return f"chain.{int(place) - by}.{rest}"


def respond(tree: Block, record: Record, path: str, before: Past) -> Floats:
    """Return the samples of a tree's response to a record's input, from the record's initial state or its past."""
    u = before.joined(input_signal(tree, record, path))
    state = begun(tree, u, record)
    out = np.empty(len(u.values))
    for part in chunks(len(out), tree):
        y, state = tree.step(u[part], state)
        out[part] = y.values
    return out[before.lead :]


def begun(tree: Block, u: Signal, record: Record) -> object:
    """Return the state before the first sample: rest, or steady at the first value where there is such a state."""
    if record.initial == "rest":
        return None
    try:
        tree.steady(float(u.values[0]), u.dt)
    except WhidError:
        return None
    return STEADY


def sensitivities(tree: Block, record: Record, names: Sequence[str], path: str, before: Past) -> tuple[Floats, Floats]:
    """Return the response of a tree and its derivatives by its free numbers, then by levels of the past, (N,) and (N, p)."""
    u = before.joined(input_signal(tree, record, path))
    state, seeds = begun(tree, u, record), before.seeds(u)
    y, j = np.empty(len(u.values)), np.empty((len(u.values), len(names) + len(seeds)))
    for part in chunks(len(u.values), tree):
        out, tangents, state = tree.tangent(u[part], [seed[part] for seed in seeds], list(names), state)
        y[part] = out.values
        j[part] = np.array([t.values for t in tangents]).reshape(j.shape[1], -1).T
    return y[before.lead :], j[before.lead :, [*range(len(seeds), j.shape[1]), *range(len(seeds))]]
