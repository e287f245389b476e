"""The Cramér-Rao bound of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from whid.fit import Estimate, minimise
from whid.record import Record
from whid.refine._free import FreeNumbers
from whid.refine._gauge import gauged
from whid.refine._problem import data_of
from whid.refine._result import expanded
from whid.signal import Floats
from whid.system import System


def bound(
    system: System, records: Sequence[Record], std: Sequence[float], *, path: str = "exact", fixed: Sequence[str] = (),
    tied: Sequence[Sequence[str]] = (), ar: Floats | None = None,
) -> Estimate:  # fmt: skip
    """Return the Cramér-Rao bound of a plan: the least standard errors that records with this input and noise allow.

    covariance = (JᵀJ)⁻¹ at the system's own numbers, J the whitened tangents over std (one a record); y is not looked at.

    >>> from whid.blocks.polynomial import Polynomial
    >>> line = System(chain=(Polynomial(coefficients=(0.0, 1.0), fix=("coefficients.0",)),))
    >>> plan = Record(u=np.array([3.0, 4.0]), y=np.full(2, np.nan), dt=1.0)
    >>> float(bound(line, [plan], [10.0], fixed=["chain.0.coefficients.0"]).std[0])
    2.0
    """
    data = data_of([replace(record, y=np.zeros(len(record))) for record in records], system.tree, std)
    if ar is not None:
        data = tuple(replace(d, ar=np.asarray(ar, float)) for d in data)
    problem, _ = gauged(FreeNumbers(system.tree, tuple(fixed), tuple(map(tuple, tied))), data, path)
    theta = problem.start
    fit = minimise(problem.cost, problem.linearise, problem.parameters, max_iterations=0)
    return expanded(problem, fit._replace(values=theta, chi2=0.0))
