"""Dynamics from level transitions alone: a first- or second-order lag in front of f or behind it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.blocks._block import STEADY, Block
from whid.blocks.chain import Chain
from whid.blocks.linear import Linear
from whid.fit import Estimate, Parameter, least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Signal, rms

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
DECIDED = 5.0  # nats: odds of 150 to 1
CANDIDATES = (("front", 1), ("front", 2), ("back", 1), ("back", 2))


class Lags(NamedTuple):
    """The four candidates 1/(a₁s + 1) and 1/(a₂s² + a₁s + 1), in front of f and behind it, and the one chosen.

    coefficients are (a₁, a₂), NaN for the first order. rms_selection is that of transitions held back. margin is
    the log-likelihood by which the chosen side of f beats the other there, (Σe² − Σe²)/2σ²κ with κ = (1 + ρ)/(1 − ρ) for the
    correlation ρ of neighbouring residuals, nats.
    """

    place: Annotated[tuple[str, ...], Quantity(dims=("candidate",))]
    order: Annotated[NDArray[np.intp], Quantity(dims=("candidate",))]
    coefficients: Annotated[Floats, Quantity("s", dims=("candidate", "power"), error="coefficients_std")]  # s, s²
    coefficients_std: Annotated[Floats, Quantity("s", dims=("candidate", "power"))]
    rms_estimation: Annotated[Floats, Quantity("output", dims=("candidate",))]
    rms_selection: Annotated[Floats, Quantity("output", dims=("candidate",))]
    chosen: int
    margin: float
    estimate: Estimate

    def table(self) -> Table:
        """Return one row a candidate."""
        rows = tuple(
            (
                ("→ " if i == self.chosen else "") + f"{place} of f", int(order),
                *(Measured(float(a), float(s)) if np.isfinite(a) else None for a, s in zip(c, e, strict=True)),
                float(self.rms_estimation[i]), float(self.rms_selection[i]),
            )
            for i, (place, order, c, e) in enumerate(
                zip(self.place, self.order, self.coefficients, self.coefficients_std, strict=True)
            )
        )  # fmt: skip
        notes = ["1/(a₂s² + a₁s + 1); → smallest error on transitions held back (three-fold), fitted to all of them"]
        if not self.decided:
            notes.append(
                f"front or back: the level transitions cannot tell (margin {self.margin:.2g} nats, {DECIDED:g} would)"
            )
        return Table(
            "Lag from the level transitions",
            ("lag", "order", "a₁, s", "a₂, s²", "rms fitted, output", "rms held back, output"),
            rows, tuple(notes),
        )  # fmt: skip

    @property
    def decided(self) -> bool:
        """Tell whether the held-back transitions can tell front from back."""
        return self.margin > DECIDED

    def block(self) -> Linear:
        """Return the chosen lag."""
        a = self.coefficients[self.chosen]
        return _lag(a[np.isfinite(a)])


def lags(u: Signal, y: Floats, f: Block, hold: NDArray[np.intp], slowest: float, folds: int = 3) -> Lags:
    """Fit every candidate to the transitions; choose by cross-validation, each transition judged when it was held back.

    u       the input with its course between samples; the record starts in the steady state of its first level
    y       (N,) output
    f       the static curve as found; it stays as it is
    hold    (N,) the number of the hold that a sample belongs to, −1 where none or where y is missing
    slowest an upper guess of the time constant, s: the settle time
    folds   transition k is held back in fold k mod folds: ways up and down are in each

    The second order is taken only where it lowers the held-back error by more than two standard errors of the difference,
    transition by transition. Standard errors allow for the correlation of neighbouring residuals (κ).
    """
    everywhere = hold >= 0
    found = [_fit(place, order, u, y, f, everywhere, _starts(order, slowest)) for place, order in CANDIDATES]
    inside = [_response(place, e.values, u, f) - y for (place, _), e in zip(CANDIDATES, found, strict=True)]
    outside = np.full((len(CANDIDATES), len(y)), np.nan)
    for fold in range(folds):
        back = everywhere & (hold % folds == fold)
        for i, ((place, order), whole) in enumerate(zip(CANDIDATES, found, strict=True)):
            rest = _fit(place, order, u, y, f, everywhere & ~back, [whole.values])
            outside[i, back] = (_response(place, rest.values, u, f) - y)[back]
    loss = np.array([np.bincount(hold[everywhere], e[everywhere] ** 2) for e in outside])
    pick = [2 * side + int(_clearly(loss[2 * side], loss[2 * side + 1])) for side in (0, 1)]
    chosen, other = sorted(pick, key=lambda i: float(loss[i].sum()))
    kappa = [_repetition(e, everywhere) for e in inside]
    variance = loss[chosen].sum() / everywhere.sum() * kappa[chosen]
    found = [_inflated(e, k) for e, k in zip(found, kappa, strict=True)]
    coefficients, std = np.full((4, 2), np.nan), np.full((4, 2), np.nan)
    for i, estimate in enumerate(found):
        coefficients[i, : len(estimate.values)], std[i, : len(estimate.values)] = estimate.values, estimate.std
    return Lags(
        tuple(p for p, _ in CANDIDATES), np.array([o for _, o in CANDIDATES]), coefficients, std,
        np.array([rms(e[everywhere]) for e in inside]), np.array([rms(e[everywhere]) for e in outside]),
        chosen, float(loss[other].sum() - loss[chosen].sum()) / (2 * variance), found[chosen],
    )  # fmt: skip


def _clearly(loss: Floats, better: Floats) -> bool:
    """Tell whether the second loss is smaller by more than two standard errors of the paired difference."""
    difference = loss - better
    std = np.std(difference, ddof=1) * np.sqrt(len(difference)) if len(difference) > 1 else np.inf
    return bool(difference.sum() > 2 * std)


def _repetition(error: Floats, where: Mask) -> float:
    """Return κ = (1 + ρ)/(1 − ρ), the factor by which neighbouring residuals repeat each other; at least 1."""
    inner = where[1:] & where[:-1]
    power = float(np.sum(error[:-1][inner] ** 2))
    rho = float(np.sum(error[1:][inner] * error[:-1][inner])) / power if power else 0.0
    rho = min(max(rho, 0.0), 0.99)
    return (1 + rho) / (1 - rho)


def _inflated(estimate: Estimate, factor: float) -> Estimate:
    return estimate._replace(std=estimate.std * np.sqrt(factor), covariance=estimate.covariance * factor)


def _starts(order: int, slowest: float) -> list[Floats]:
    return [np.array([tau, (tau / 3) ** 2][:order]) for tau in slowest * np.array([0.2, 0.05, 0.6])]


def _fit(place: str, order: int, u: Signal, y: Floats, f: Block, where: Mask, starts: list[Floats]) -> Estimate:
    """Return the best fit of several starts; values are (a₁, a₂)."""

    def residual(a: Floats) -> Floats:
        return np.asarray((_response(place, a, u, f) - y)[where])

    def tangent(a: Floats) -> Floats:
        tree, lag = _tree(place, a, f)
        rates = tree.tangent(u, [], [f"chain.{lag}.den.{order - 1 - k}" for k in range(order)], STEADY).tangents
        return np.stack([r.values[where] for r in rates], axis=1)

    def attempts() -> Iterator[Estimate]:
        for start in starts:
            limits = [Parameter(f"a.{k + 1}", a, f"s**{k + 1}", (0.01 * u.dt) ** (k + 1)) for k, a in enumerate(start)]
            yield least_squares(residual, tangent, limits, max_iterations=40, tolerance=1e-4)

    return min(attempts(), key=lambda e: e.chi2)


def _lag(a: Floats) -> Linear:
    return Linear(num=(1.0,), den=(*(float(x) for x in a[::-1]), 1.0))


def _tree(place: str, a: Floats, f: Block) -> tuple[Chain, int]:
    return (Chain(chain=(_lag(a), f)), 0) if place == "front" else (Chain(chain=(f, _lag(a))), 1)


def _response(place: str, a: Floats, u: Signal, f: Block) -> Floats:
    return _tree(place, a, f)[0].step(u, STEADY)[0].values
