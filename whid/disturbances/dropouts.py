"""A sensor that hangs."""

from __future__ import annotations

from dataclasses import dataclass

from whid.disturbances.outliers import Outliers


@dataclass(frozen=True, kw_only=True)
class Dropouts(Outliers):
    """Samples that are wrong because the sensor hung: what it is worth to know of them is how many, and how wrong.

    e = b·N(0, 1)/√rate, b = 1 with probability rate, else 0; std is that of all samples together. Where they are a record
    says itself: runs of equal values (a fit leaves them out).

    >>> Dropouts(std=1.0, rate=0.02).covariance(2, 0.1)
    array([1., 0.])
    """
