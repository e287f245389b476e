"""The test that output against inner signal is one static curve, and the phase at which it is: the Lissajous family."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._noise_test import ROUNDING, noise_test
from whid.stages.periods import Complexes, Harmonics

RIVAL = 10.8  # χ² by which another phase must be worse, else the data do not tell them apart
CLEAR = 3.0  # standard errors: a slope beyond has a sign
NEWTON = 50


class StaticTest(NamedTuple):
    """Static test: the phase that makes (A cos(ωt + phase), y) a curve, that curve's harmonics, and whether it is one.

    y(t) = Σ along[k] cos k(ωt + arg drive + phase). The phase is known modulo π until a slope resolves the branch.
    """

    phase: Annotated[float, Quantity("rad", error="phase_std")]
    phase_std: Annotated[float, Quantity("rad")]
    along: Annotated[Floats, Quantity("output", ("order",), error="along_std")]  # (n + 1,)
    along_std: Annotated[Floats, Quantity("output", ("order",))]
    statistic: float  # F(dof, dof_noise); χ²(dof) where the noise differs between orders: dof_noise 0
    dof: int
    dof_noise: int
    p: float
    static: bool
    rivals: Annotated[Floats, Quantity("rad", ("rival",))]  # other phases that fit as well
    branch: str  # open: phase or phase + π; resolved

    @property
    def ambiguous(self) -> bool:
        """Tell whether another phase than ± π fits as well: a curve that is even about its middle, or little signal."""
        return bool(len(self.rivals))

    @property
    def slope(self) -> Measured:
        """Return dy/dcos at the middle of the curve, Σ along[k]·T′_k(0), in output units per amplitude."""
        k = np.arange(len(self.along))
        rate = k * np.sin(k * np.pi / 2)
        return Measured(float(rate @ self.along), float(np.linalg.norm(rate * self.along_std)))

    def table(self) -> Table:
        """Return one row and the verdict."""
        row = (Measured(self.phase, self.phase_std), float(f"{self.statistic:.4g}"), self.dof, self.dof_noise or None,
               float(f"{self.p:.3g}"))  # fmt: skip
        notes = ["one static curve" if self.static else "no static curve: the input left its piece, or the degree is higher"]
        notes += [f"as good: {', '.join(f'{phase:.4g}' for phase in self.rivals)} rad"] if self.ambiguous else []
        notes += ["the phase or π more: no slope tells them apart"] if self.branch == "open" else []
        columns = ("phase, rad", "F" if self.dof_noise else "χ²", "dof", "dof of noise", "p")
        return Table("Static test", columns, (row,), tuple(notes))


def static_test(
    harmonics: Harmonics, degree: int, drive: complex = 1.0, orders: int = 10, significance: float = 0.01
) -> StaticTest:
    """Find the phase at which output against inner sine is a polynomial curve of a degree, and test that it is one.

    phase = argmin Σ_{1≤k≤n} Im(Y_k e^{−jk(phase + arg drive)})²/std_k², a trigonometric polynomial in 2·phase, over
    (−π/2, π/2]: every minimum of a fine grid is polished by Newton, the least is exact. The rest of Σ_{k≤H} |Y_k|²/std²,
    n − 1 + 2(H − n) degrees of freedom, is noise if the curve is static. std = 1/√Σ(k·along_k/std_k)²: the Cramér-Rao bound.
    drive: phasor of the input sine. Rivals: other minima less than 10.8 above the least.
    Raises `WhidError("stage-too-short")` where fewer than `degree` harmonics were measured.
    Source [Brouri2014], Propositions 1-2, Table 1 (whose plot over δ this replaces), eq. (14).

    >>> from whid.stages.periods import harmonics
    >>> x = np.cos(0.02 * np.pi * np.arange(2000) - 0.7)
    >>> found = static_test(harmonics(x + 0.3 * x**2 + 0.1 * x**3, 100), degree=3)
    >>> round(found.phase, 9), found.static, found.along.round(3)
    (-0.7, True, array([0.15 , 1.075, 0.15 , 0.025]))
    """
    if degree < 1 or len(harmonics.order) <= degree:
        raise WhidError(
            "stage-too-short",
            f"a curve of degree {degree} needs harmonics 1 … {max(degree, 1)}, {len(harmonics.order) - 1} given",
        )
    most = max(min(orders, len(harmonics.order) - 1), degree)
    floor = ROUNDING * max(float(np.abs(harmonics.value).max()), 1e-300)
    value = harmonics.value[: most + 1] * np.exp(-1j * np.arange(most + 1) * np.angle(drive))
    std, own = (np.hypot(each[: most + 1], floor) for each in (harmonics.value_std, harmonics.own_std))
    k = np.arange(1, degree + 1)
    phases, costs = _minima(value[k], std[k])
    phase = float(phases[0])
    turned = value[: degree + 1] * np.exp(-1j * np.arange(degree + 1) * phase)
    along = np.real(turned)
    information = float(np.sum((k * along[k] / std[k]) ** 2))
    square = np.append(np.imag(turned[1:]) ** 2, np.abs(value[degree + 1 :]) ** 2)
    dof = np.append(np.ones(degree, np.intp), np.full(most - degree, 2))
    dof[np.argmax((k * along[k] / std[k]) ** 2)] -= 1  # the phase takes one, of the order that tells most about it
    found = noise_test(square, dof, own[1:], harmonics.own_lines)
    rivals = phases[1:][costs[1:] - costs[0] < RIVAL]
    return StaticTest(
        phase, 1 / np.sqrt(information) if information else float("inf"), along, std[: degree + 1], *found,
        found.p >= significance, rivals, "open",
    )  # fmt: skip


def on_branch(found: StaticTest, slope: Measured) -> StaticTest:
    """Return the test with its phase on the branch where the curve rises as the staircase does.

    slope: of the static curve at the sine's offset, with its error. The phase is then that of G(jω)/G(0), absolute. Where
    either slope is within 3 standard errors of 0 the branch stays open. Source [Brouri2014], Remark 2.

    >>> from whid.stages.periods import harmonics
    >>> x = np.cos(0.02 * np.pi * np.arange(2000) - 2.5)
    >>> found = static_test(harmonics(x + 0.3 * x**2, 100), degree=2)
    >>> round(found.phase, 3), round(on_branch(found, Measured(1.0, 0.1)).phase, 3)
    (0.642, -2.5)
    """
    own = found.slope
    if min(abs(own.value) - CLEAR * own.std, abs(slope.value) - CLEAR * slope.std) <= 0:
        return found
    if own.value * slope.value > 0:
        return found._replace(branch="resolved")
    sign = (-1.0) ** np.arange(len(found.along))
    phase = found.phase - np.pi if found.phase > 0 else found.phase + np.pi
    return found._replace(phase=phase, along=found.along * sign, branch="resolved")


def lissajous_cost(harmonics: Harmonics, degree: int, phase: Floats, drive: complex = 1.0) -> Floats:
    """Return the criterion of `static_test` at any phases: what the Lissajous family looks like to it, (len(phase),)."""
    k = np.arange(1, degree + 1)
    value = harmonics.value[k] * np.exp(-1j * k * np.angle(drive))
    return _cost(value, harmonics.value_std[k], np.asarray(phase, float))


def _cost(value: Complexes, std: Floats, phase: Floats) -> Floats:
    k = np.arange(1, len(value) + 1)
    return np.asarray(np.sum((np.imag(value * np.exp(-1j * np.multiply.outer(phase, k))) / std) ** 2, axis=-1))


def _minima(value: Complexes, std: Floats) -> tuple[Floats, Floats]:
    """Return all minima of the criterion in (−π/2, π/2], the least first, and their costs."""
    n = len(value)
    k, square = np.arange(1, n + 1), (value / std) ** 2
    grid = -np.pi / 2 + np.pi * np.arange(1, 32 * n + 1) / (32 * n)
    cost = _cost(value, std, grid)
    low: NDArray[np.bool_] = (cost <= np.roll(cost, 1)) & (cost < np.roll(cost, -1))
    phase = grid[low] if low.any() else grid[[int(np.argmin(cost))]]
    for _ in range(NEWTON):
        turn = square * np.exp(-2j * np.multiply.outer(phase, k))
        slope, curvature = -turn.imag @ k, 2 * turn.real @ k**2
        step = np.where(curvature > 0, slope / np.where(curvature > 0, curvature, 1.0), 0.0)
        phase = phase - np.clip(step, -np.pi / (64 * n), np.pi / (64 * n))
        if np.abs(step).max() < 1e-15:
            break
    phase = np.pi / 2 - np.mod(np.pi / 2 - phase, np.pi)
    cost = _cost(value, std, phase)
    order = np.argsort(cost)
    return phase[order], cost[order]
