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
from whid.signal import Signal

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
DECIDED = 5.0  # nats: odds of 150 to 1
CANDIDATES = (("front", 1), ("front", 2), ("back", 1), ("back", 2))


class Lags(NamedTuple):
    """The four candidates 1/(a₁s + 1) and 1/(a₂s² + a₁s + 1), in front of f and behind it, and the one chosen.

    coefficients are (a₁, a₂), NaN for the first order. rms_selection is on transitions that the fit did not use. margin is
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
        notes = ["1/(a₂s² + a₁s + 1); → smallest error on the transitions held back, then fitted to all of them"]
        if not self.decided:
            notes.append(
                f"front or back: the level transitions cannot tell (margin {self.margin:.2g} nats, {DECIDED:g} would)"
            )
        return Table(
            "Lag from the level transitions", ("lag", "order", "a₁, s", "a₂, s²", "rms, fitted", "rms, held back"),
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


def lags(u: Signal, y: Floats, f: Block, hold: NDArray[np.intp], held_back: Mask, slowest: float) -> Lags:
    """Fit every candidate to the transitions, choose on those held back, then refit the chosen one to all.

    u       the input with its course between samples; the record starts in the steady state of its first level
    y       (N,) output
    f       the static curve as found; it stays as it is
    hold    (N,) the number of the hold that a sample belongs to, −1 where none or where y is missing
    held_back (holds,) which transitions select; the others fit
    slowest an upper guess of the time constant, s: the settle time

    The second order is taken only where it lowers the held-back error by more than one standard error of the difference,
    transition by transition.
    """
    inside, outside = ((hold >= 0) & (held_back[hold] == side) for side in (False, True))
    found = [_fit(place, order, u, y, f, inside, slowest) for place, order in CANDIDATES]
    errors = np.array([_response(place, e.values, u, f) - y for (place, _), e in zip(CANDIDATES, found, strict=True)])
    judged = outside if outside.any() else inside
    loss = np.array([np.bincount(hold[judged], e[judged] ** 2, len(held_back)) for e in errors])[:, held_back]
    pick = [2 * side + int(_clearly(loss[2 * side], loss[2 * side + 1])) for side in (0, 1)]
    chosen, other = sorted(pick, key=lambda i: float(loss[i].sum()))
    margin = float(loss[other].sum() - loss[chosen].sum()) / (2 * _long_run_variance(errors[chosen], judged))
    rms = [[float(np.sqrt(np.mean(e[m] ** 2))) if m.any() else np.nan for e in errors] for m in (inside, outside)]
    found[chosen] = _fit(*CANDIDATES[chosen], u, y, f, inside | outside, slowest)
    coefficients, std = np.full((4, 2), np.nan), np.full((4, 2), np.nan)
    for i, estimate in enumerate(found):
        coefficients[i, : len(estimate.values)], std[i, : len(estimate.values)] = estimate.values, estimate.std
    return Lags(
        tuple(p for p, _ in CANDIDATES), np.array([o for _, o in CANDIDATES]), coefficients, std, np.array(rms[0]),
        np.array(rms[1]), chosen, margin, found[chosen],
    )  # fmt: skip


def _clearly(loss: Floats, better: Floats) -> bool:
    """Tell whether the second loss is smaller by more than one standard error of the paired difference."""
    difference = loss - better
    std = np.std(difference, ddof=1) * np.sqrt(len(difference)) if len(difference) > 1 else np.inf
    return bool(difference.sum() > std)


def _long_run_variance(error: Floats, where: Mask) -> float:
    """Return the variance of residuals times κ, the factor by which neighbours repeat each other."""
    inner = where[1:] & where[:-1]
    variance = float(np.mean(error[where] ** 2))
    rho = float(np.mean(error[1:][inner] * error[:-1][inner])) / variance if inner.any() and variance else 0.0
    rho = min(max(rho, 0.0), 0.99)
    return variance * (1 + rho) / (1 - rho) or np.finfo(float).tiny


def _fit(place: str, order: int, u: Signal, y: Floats, f: Block, where: Mask, slowest: float) -> Estimate:
    """Return the best fit of several starts; values are (a₁, a₂)."""

    def residual(a: Floats) -> Floats:
        return np.asarray((_response(place, a, u, f) - y)[where])

    def tangent(a: Floats) -> Floats:
        tree, lag = _tree(place, a, f)
        rates = tree.tangent(u, [], [f"chain.{lag}.den.{order - 1 - k}" for k in range(order)], STEADY).tangents
        return np.stack([r.values[where] for r in rates], axis=1)

    def attempts() -> Iterator[Estimate]:
        for fraction in (0.2, 0.05, 0.6):
            tau = slowest * fraction
            start = [tau, (tau / 3) ** 2][:order]
            low = 0.01 * u.dt
            limits = [Parameter(f"a.{k + 1}", a, f"s**{k + 1}", lower=low ** (k + 1)) for k, a in enumerate(start)]
            yield least_squares(residual, tangent, limits, max_iterations=40, tolerance=1e-4)

    return min(attempts(), key=lambda e: e.chi2)


def _lag(a: Floats) -> Linear:
    return Linear(num=(1.0,), den=(*(float(x) for x in a[::-1]), 1.0))


def _tree(place: str, a: Floats, f: Block) -> tuple[Chain, int]:
    return (Chain(chain=(_lag(a), f)), 0) if place == "front" else (Chain(chain=(f, _lag(a))), 1)


def _response(place: str, a: Floats, u: Signal, f: Block) -> Floats:
    return _tree(place, a, f)[0].step(u, STEADY)[0].values
