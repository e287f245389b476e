"""Linear blocks with a root less: what a fit may turn out not to need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whid.blocks.linear import Linear
from whid.fit import Estimate
from whid.signal import Floats
from whid.system import System

HOPELESS = 100.0  # χ² beyond which a root is not tried without: its standard error is a local one


def fewer(system: System, estimate: Estimate) -> Iterator[tuple[str, System]]:
    """Yield (what is gone, the system without) for every root of the continuous linear blocks that may be none.

    A pole or zero at infinity: its polynomial's leading coefficient is small against its standard error. A pole and a zero
    that cancel: their distance is. Both static gains stay 1. The other numbers are as they were: starts for a fit.

    >>> lag = Linear(num=(1.0,), den=(0.002, 1.0, 1.0))
    >>> fit = Estimate(("chain.0.den.0",), np.array([0.002]), np.array([0.001]), np.eye(1) * 1e-6, 1, np.empty((0, 1)),
    ...                1.0, 1, 1, "converged")
    >>> [(said, [round(a, 3) for a in found.chain[0].den]) for said, found in fewer(System(chain=(lag,)), fit)]
    [('chain.0 has one pole less', [0.998, 1.0])]
    """
    for place, block in enumerate(system.chain):
        if not isinstance(block, Linear) or block.num is None or block.den is None or block.dt is not None:
            continue
        path, num, den = f"chain.{place}", np.array(block.num), np.array(block.den)
        found: list[tuple[str, Any, Any]] = []
        if len(den) > max(len(num), 2) and _small(estimate, f"{path}.den.0"):
            found.append(("one pole", num, _without_fastest(den)))
        if len(num) > 1 and _small(estimate, f"{path}.num.0"):
            found.append(("one zero", _without_fastest(num), den))
        if len(num) > 1 and len(den) > 2 and (pair := _cancelling(estimate, path, num, den)) is not None:
            found.append(("one pole and one zero", *pair))
        for said, top, bottom in found:
            changed = replace(block, num=tuple(map(float, top)), den=tuple(map(float, bottom)))
            chain = (*system.chain[:place], changed, *system.chain[place + 1 :])
            yield f"{path} has {said} less", replace(system, chain=chain)


def _small(estimate: Estimate, name: str) -> bool:
    if name not in estimate.names:
        return False
    k = estimate.names.index(name)
    return bool(estimate.values[k] ** 2 < HOPELESS * estimate.std[k] ** 2)


def _without_fastest(polynomial: Floats) -> Floats:
    """Return the polynomial (descending, constant 1) without its fastest real root, or leading term where none is real."""
    roots = np.roots(polynomial)
    real = np.flatnonzero(np.abs(roots.imag) < 1e-9 * np.abs(roots))
    if not len(real):
        return polynomial[1:]
    return _unit(np.delete(roots, real[np.argmax(np.abs(roots[real]))]))


def _cancelling(estimate: Estimate, path: str, num: Floats, den: Floats) -> tuple[Floats, Floats] | None:
    """Return num and den without the real pole and the real zero that are nearest, where their distance may be none."""
    names = [f"{path}.num.{k}" for k in range(len(num))] + [f"{path}.den.{k}" for k in range(len(den))]
    known = [k for k, name in enumerate(names) if name in estimate.names]
    pair = _nearest(num, den)
    if pair is None or not known:
        return None
    both, rates = np.concatenate([num, den]), []
    for k in known:
        moved = both.copy()
        moved[k] += 1e-7 * max(abs(both[k]), 1e-12)
        zeros, poles = np.roots(moved[: len(num)]), np.roots(moved[len(num) :])
        gap = poles[np.argmin(np.abs(poles - pair[1]))] - zeros[np.argmin(np.abs(zeros - pair[0]))]
        rates.append(float(np.real(gap - (pair[1] - pair[0]))) / (moved[k] - both[k]))
    own = [estimate.names.index(names[k]) for k in known]
    variance = float(np.array(rates) @ estimate.covariance[np.ix_(own, own)] @ np.array(rates))
    if (pair[1] - pair[0]) ** 2 > HOPELESS * variance:
        return None
    zeros, poles = np.roots(num), np.roots(den)
    left = np.delete(zeros, np.argmin(np.abs(zeros - pair[0]))), np.delete(poles, np.argmin(np.abs(poles - pair[1])))
    return _unit(left[0]), _unit(left[1])


def _nearest(num: Floats, den: Floats) -> tuple[float, float] | None:
    """Return the real zero and the real pole whose ratio is nearest to 1."""
    real = [roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real for roots in (np.roots(num), np.roots(den))]
    pairs = [(float(z), float(p)) for z in real[0] for p in real[1] if z * p > 0]
    return min(pairs, key=lambda pair: abs(np.log(pair[1] / pair[0])), default=None)


def _unit(roots: NDArray[Any]) -> Floats:
    """Return the polynomial of these roots, constant 1."""
    found = np.real(np.atleast_1d(np.poly(roots)))
    return np.asarray(found / found[-1])
