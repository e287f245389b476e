"""The linear approximation of windows, its rational fits, and the roots and filters that a nonlinear fit starts from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from whid.errors import WhidError
from whid.methods._windows import Windows
from whid.stages._cascade import Filter
from whid.stages.best_linear import SHORT, BestLinear, Complexes, best_linear, local_polynomial, realisations
from whid.stages.linear_fit import LinearFit, alternatives, linear_fit
from whid.stages.linear_in_time import linear_in_time

LEAD = 6  # parts of a short record, the first of which its filters may settle in
REALISATIONS = 4  # multisines with phases of their own, from which on their scatter tells the distortion
TOTALS = range(1, 9)  # poles of the linear approximation that are tried


def linear_starts(data: Windows, orders: Sequence[int] | None, seed: int) -> tuple[BestLinear, list[LinearFit]]:
    """Return the linear approximation and its fit of the total order given, or the three fits of the best BIC.

    Where no stable fit goes through Welch's response of a short record, the local polynomial's is taken.
    """
    rng = np.random.default_rng(seed)
    totals = TOTALS if orders is None else [sum(orders)]
    periods = data.periods
    many = len(periods) >= REALISATIONS
    bla = realisations(periods, data.dt) if many else best_linear(data.signals, data.dt)
    fits = [fit for total in totals if (fit := _fitted(bla, total, rng)) is not None]
    if not fits and data.samples < SHORT:
        bla = local_polynomial(*data.signals[0], data.dt)
        fits = [fit for total in totals if (fit := _fitted(bla, total, rng)) is not None]
    if not fits and data.samples < SHORT:
        data.lead = data.longest // LEAD
        fits = [linear_in_time(data.every(), total, data.dt) for total in totals if total]
    fits = fits or [linear_fit(bla, totals, rng)]  # its fault says what is wrong
    return bla, sorted(fits, key=lambda fit: float(fit.bic.min()))[:3]


def roots(data: Windows, fit: LinearFit, bla: BestLinear) -> Iterator[tuple[Complexes, Complexes]]:
    """Yield (zeros, poles) to share: those of the response, and of a short record those of a fit in time as well.

    In time the distortion of a nonlinear system weighs like noise: long records tell the poles better by their response.
    """
    yield from alternatives(fit, bla)
    if data.samples < SHORT:
        start = Filter.of_roots(fit.zeros[: len(fit.poles)], fit.poles)
        able = np.all(np.isfinite(np.concatenate(start))) and start.stable
        found = linear_in_time(data.every(), len(fit.poles), data.dt, [start] if able else [])
        yield found.zeros, found.poles


def filters(data: Windows, fits: Sequence[LinearFit], bla: BestLinear) -> list[Filter]:
    """Return the linear approximations, whole, as one filter each."""
    found = [Filter.of_roots(zeros[: len(poles)], poles) for fit in fits for zeros, poles in roots(data, fit, bla)]
    return [h for h in found if np.all(np.isfinite(np.concatenate(h))) and h.stable]


def _fitted(bla: BestLinear, total: int, rng: np.random.Generator) -> LinearFit | None:
    try:
        return linear_fit(bla, [total], rng)
    except WhidError:  # no stable one: there are other orders
        return None
