"""Periodic records in sufficient statistics: the mean settled period stands for all of them, at a fraction of the cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from whid.blocks._block import Block
from whid.blocks._static import Static
from whid.blocks.chain import Chain
from whid.blocks.linear import Linear
from whid.blocks.parallel import Parallel
from whid.experiments._part import Part
from whid.record import Record
from whid.refine._free import walk
from whid.refine._problem import Data, memory

SETTLED = 36.0  # time constants: e⁻³⁶ is rounding


def periodic(data: Data, tree: Block) -> Iterator[Data]:
    """Yield a record as its averaged periodic parts and what is left of it.

    Σ over samples of n whole periods (y − ŷ)² = n Σ over one period (ȳ − ŷ)² + the scatter of the periods, where ŷ is
    periodic: settled. Chains of filters and static curves start in the state that the period leads back to. Lead periods are
    left out. A part whose input does not repeat exactly, or with missing samples, stays.
    """
    use = data.use.copy()
    for part in data.record.parts:
        averaged = _averaged(data.record, part, tree)
        if averaged is not None:
            use[part.start : part.stop] = False
            yield averaged
    if use.any():
        last = int(np.flatnonzero(use)[-1]) + 1
        r = data.record
        valid = None if r.valid is None else r.valid[:last]
        yield replace(data, record=replace(r, u=r.u[:last], y=r.y[:last], valid=valid), use=use[:last])


def _averaged(record: Record, part: Part, tree: Block) -> Data | None:
    period, lead = getattr(part, "period", None), int(getattr(part, "lead_periods", 0))
    if part.use != "estimation" or period is None or period != round(period) or record.intersample == "bandlimited":
        return None
    p = int(period)
    first = (part.start or 0) + lead * p
    count = ((part.stop or 0) - first) // p
    span = slice(first, first + count * p)
    if count < 2 or not record.mask[span].all() or not np.isfinite(record.y[span]).all():
        return None
    u, y = record.u[span].reshape(count, p), record.y[span].reshape(count, p)
    if np.abs(u - u[0]).max() > 1e-9 * np.ptp(u[0]):
        return None
    mean, returns = y.mean(axis=0), _returns(tree)
    settle = 0 if returns else int(np.ceil(SETTLED / 3 * memory(tree, record.dt, len(record)) / p))
    short = replace(
        record, u=np.tile(u[0], settle + 2), y=np.tile(mean, settle + 2), valid=None, parts=(), initial="rest"
    )  # the period after the one that counts: what holds between samples goes on
    use = np.zeros(len(short), bool)
    use[settle * p : (settle + 1) * p] = True
    return Data(short, use, periods=count, scatter=float(np.sum((y - mean) ** 2)), returns=returns)


def _returns(tree: Block) -> bool:
    """Tell whether a tree finds the state that a period leads back to; others are simulated until they have settled."""
    return all(isinstance(b, Chain | Parallel | Static) or (isinstance(b, Linear) and _decays(b)) for _, b in walk(tree))


def _decays(block: Linear) -> bool:
    poles = block.eigenvalues()
    return bool(np.all(poles.real < 0 if block.dt is None else np.abs(poles) < 1))
