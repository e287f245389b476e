"""A rational transfer function through a measured frequency response: poles, zeros, orders by BIC."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.fit import Estimate, Parameter, least_squares, linear_least_squares
from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages._cascade import Filter, from_delta
from whid.stages.best_linear import BestLinear

Complexes = NDArray[np.complex128]
LOW_Q = 0.55  # damping beyond which a complex pair of a noisy fit is often two real poles


class LinearFit(NamedTuple):
    """Poles and zeros (z) of the best linear approximation, at the record's rate.

    bic = χ² + p·log(lines) of every (zeros, poles) tried; smaller is better. agreeing: of `starts` random starts, how many
    ended in the best minimum.
    """

    poles: Annotated[Complexes, Quantity("1", ("pole",))]
    zeros: Annotated[Complexes, Quantity("1", ("zero",))]
    gain: Annotated[float, Quantity("output/input")]  # at frequency zero
    tried: Annotated[NDArray[np.intp], Quantity(dims=("candidate", "order"))]
    bic: Annotated[Floats, Quantity(dims=("candidate",))]
    starts: int
    agreeing: int
    estimate: Estimate
    dt: Annotated[float, Quantity("s")]

    def table(self) -> Table:
        """Return poles and zeros as frequency and damping."""
        rows = []
        for kind, roots in (("pole", self.poles), ("zero", self.zeros)):
            for root in roots[roots.imag >= 0]:
                s = np.log(root + 0j) / self.dt
                frequency, damping = float(f"{abs(s) / (2 * np.pi):.4g}"), float(f"{-s.real / abs(s):.4g}")
                rows.append((kind, "pair" if root.imag else "real", frequency, damping))
        e = self.estimate
        fit = f"χ²/dof {e.chi2:.1f}/{e.dof}; {self.agreeing} of {self.starts} starts agree"
        note = f"orders by BIC among {len(self.bic)}; poles and zeros mapped to s by log(z)/dt"
        return Table("Linear fit", ("root", "kind", "frequency Hz", "damping"), tuple(rows), (fit, note))


def linear_fit(
    bla: BestLinear, poles: Sequence[int], rng: np.random.Generator, zeros: Sequence[int] | None = None, starts: int = 6
) -> LinearFit:
    """Fit G(z) to a best linear approximation, weighted by 1/std, for every number of poles given; keep the best BIC.

    Sanathanan-Koerner iteration, then Levenberg-Marquardt; from a flat denominator and from random stable ones. zeros: how
    many to try; left out: up to as many as poles. Source [Sanathanan and Koerner 1963]; [Pintelon and Schoukens 2012], 9.8.
    """
    delta = 1 - np.exp(-1j * bla.omega * bla.dt)
    found: dict[tuple[int, int], list[Estimate]] = {}
    for n in poles:
        for m in zeros if zeros is not None else range(max(0, n - 3), n + 1):
            ends = [_descended(delta, bla, start, m, n) for start in _starts(delta, bla, m, n, rng, starts)]
            found[m, n] = [e for e in ends if e is not None and _stable(e.values[m + 1 :])]
    bic = {order: _bic(min(ends, key=lambda e: e.chi2), len(delta)) for order, ends in found.items() if ends}
    if not bic:
        raise WhidError("stage-no-linear-fit", f"no stable transfer function with {list(poles)} poles fits the response")
    m, n = min(bic, key=lambda order: bic[order])
    best = min(found[m, n], key=lambda e: e.chi2)
    agreeing = sum(e.chi2 < best.chi2 + 0.1 for e in found[m, n])
    num, den = from_delta(best.values[: m + 1]), from_delta(np.append(1.0, best.values[m + 1 :]))
    return LinearFit(
        np.roots(den).astype(complex), np.roots(num).astype(complex), float(best.values[0]), np.array(list(bic)),
        np.array(list(bic.values())), starts, agreeing, best, bla.dt,
    )  # fmt: skip


def matched(response: Complexes, omega_dt: Floats, zeros: int, poles: int) -> Filter:
    """Return the stable filter of unit static gain nearest to a response at frequencies omega·dt.

    Sanathanan-Koerner; poles that come out unstable are mirrored into the unit circle, the numerator fitted again.
    """
    delta, one = 1 - np.exp(-1j * omega_dt), np.ones(len(omega_dt))
    values = _sanathanan(delta, response, one, zeros, poles, np.ones(len(delta), complex), unit=True)
    found = Filter(values[:zeros], values[zeros:])
    if found.stable:
        return found
    roots = np.roots(found.den_z)
    inside = np.where(np.abs(roots) < 1, roots, 0.99 / np.maximum(np.abs(roots), 1 / 0.99) ** 2 * roots)
    stable = Filter.of_roots(np.empty(0, complex), inside)
    den = np.polyval(stable.den_z[::-1], 1 - delta)
    design = np.vander(delta, zeros + 1, increasing=True)[:, 1:] / den[:, None]
    num = _solved(design, response - 1 / den)
    return Filter(np.asarray(num), stable.den)


def alternatives(fit: LinearFit, bla: BestLinear) -> Iterator[tuple[Complexes, Complexes]]:
    """Yield (zeros, poles): as fitted, then with each pair of low Q as a double real pole, the numerator refitted.

    No start needs more than that: of 187 random plants of two pairs of poles about a curve, real, resonant or close
    together, in 2000 samples with 1 or 10 % noise, all splits of these roots left one above a start at the truth, by 5 %
    of its error.
    """
    yield fit.zeros, fit.poles
    s = np.log(fit.poles + 0j)
    for pair in fit.poles[(fit.poles.imag > 0) & (-s.real / np.abs(s) > LOW_Q)]:
        poles = np.where(np.isin(fit.poles, [pair, pair.conj()]), np.abs(pair), fit.poles)
        yield _numerator(bla, poles, len(fit.zeros)), poles


def _numerator(bla: BestLinear, poles: Complexes, zeros: int) -> Complexes:
    backward = np.exp(-1j * bla.omega * bla.dt)
    den = np.polyval(np.real(np.poly(poles))[::-1], backward)
    design = np.vander(1 - backward, zeros + 1, increasing=True) / (den * bla.std)[:, None]
    num = _solved(design, bla.response / bla.std)
    return np.asarray(np.roots(from_delta(num)), complex)


def _starts(delta: Complexes, bla: BestLinear, m: int, n: int, rng: np.random.Generator, count: int) -> Iterator[Floats]:
    for k in range(count):
        radius = rng.uniform(0.3, 0.97, n)
        den = np.ones(len(delta), complex) if not k else np.prod(1 - radius[:, None] * (1 - delta), axis=0)
        yield _sanathanan(delta, bla.response, bla.std, m, n, den, unit=False)


def _sanathanan(delta: Complexes, response: Complexes, std: Floats, m: int, n: int, den: Complexes, *, unit: bool) -> Floats:
    """Iterate Σ |N(δ) − G·D(δ)|²/(std·|D_before|)², D(0) = 1, and with `unit` N(0) = 1."""
    power = np.vander(delta, max(m, n) + 1, increasing=True)
    first = int(unit)
    values = np.zeros(m + 1 - first + n)
    for _ in range(30):
        weight = 1 / (std * np.abs(den))
        design = np.hstack([power[:, first : m + 1], -response[:, None] * power[:, 1 : n + 1]]) * weight[:, None]
        values = _solved(design, (response - first) * weight)
        den = power[:, : n + 1] @ np.append(1.0, values[m + 1 - first :])
    return np.asarray(values)


def _descended(delta: Complexes, bla: BestLinear, start: Floats, m: int, n: int) -> Estimate | None:
    power = np.vander(delta, max(m, n) + 1, increasing=True)

    def parts(x: Floats) -> tuple[Complexes, Complexes]:
        return power[:, : m + 1] @ x[: m + 1], 1 + power[:, 1 : n + 1] @ x[m + 1 :]

    def residual(x: Floats) -> Floats:
        num, den = parts(x)
        return _stacked((num / den - bla.response) / bla.std)

    def tangent(x: Floats) -> Floats:
        num, den = parts(x)
        rates = np.hstack([power[:, : m + 1], -(num / den)[:, None] * power[:, 1 : n + 1]])
        return _stacked(rates / (den * bla.std)[:, None])

    if not np.all(np.isfinite(start)):
        return None
    names = [f"num.{k}" for k in range(m + 1)] + [f"den.{k + 1}" for k in range(n)]
    free = [Parameter(name, float(value)) for name, value in zip(names, start, strict=True)]
    return least_squares(residual, tangent, free, np.ones(2 * len(delta)), max_iterations=50, tolerance=1e-3)


def _bic(estimate: Estimate, lines: int) -> float:
    return estimate.chi2 + len(estimate.values) * float(np.log(2 * lines))


def _stable(den: Floats) -> bool:
    return bool(np.all(np.abs(np.roots(from_delta(np.append(1.0, den)))) < 1))


def _stacked(values: NDArray[Any]) -> Floats:
    return np.concatenate([values.real, values.imag])


def _solved(design: NDArray[Any], target: NDArray[Any]) -> Floats:
    """Return the real numbers that take complex columns nearest to a complex target."""
    return linear_least_squares(_stacked(design), _stacked(target)).values
