"""What a model leaves unexplained."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.predict import predict
from whid.record import Record
from whid.signal import Floats


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
