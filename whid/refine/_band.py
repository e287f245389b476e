"""The confidence band of a prediction."""

from __future__ import annotations

import numpy as np

from whid.blocks._block import STEADY, Block
from whid.blocks._stack import stacked
from whid.fit import Estimate
from whid.predict import chunks, input_signal
from whid.record import Record
from whid.signal import Floats


def band(tree: Block, record: Record, estimate: Estimate, path: str = "exact") -> Floats:
    """Return the standard error of every sample of ŷ that the numbers' own errors make: sqrt(diag(J Σ Jᵀ)), (N,).

    Numbers that the estimate names but the tree does not have are left out, as are those without a finite error.
    """
    known = {p.name for p in tree.parameters(held=True)}
    keep = [k for k, name in enumerate(estimate.names) if name in known and np.isfinite(estimate.std[k])]
    covariance = estimate.covariance[np.ix_(keep, keep)]
    u = input_signal(tree, record, path)
    state = None if record.initial == "rest" else STEADY
    out = np.empty(len(record))
    for part in chunks(len(record), tree):
        _, tangents, state = tree.tangent(u[part], [], [estimate.names[k] for k in keep], state)
        j = stacked(tangents).values if keep else np.zeros((0, part.stop - part.start))
        out[part] = np.sqrt(np.maximum(np.sum(j * (covariance @ j), axis=0), 0.0))
    return out
