"""What a model leaves unexplained."""

from __future__ import annotations

import numpy as np

from whid.blocks._block import Block
from whid.predict import predict
from whid.record import Record
from whid.signal import Floats


def residual(tree: Block, record: Record, path: str = "exact") -> Floats:
    """Return y − ŷ of a record, NaN where y is missing.

    >>> from whid.blocks.linear import Linear
    >>> gain = Linear(num=(2.0,), den=(1.0,))
    >>> residual(gain, Record(u=np.ones(2), y=np.array([2.5, np.nan]), dt=1.0))
    array([0.5, nan])
    """
    return np.where(record.mask, record.y - predict(tree, record, path), np.nan)
