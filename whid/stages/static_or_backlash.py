"""Is what follows the linear block a static curve, or has it memory: all sines together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages._noise_test import ROUNDING, noise_test
from whid.stages.constant_test import constant_test
from whid.stages.periods import Harmonics
from whid.stages.static_test import static_test

HIGHEST = 20  # harmonics looked at
SIGNIFICANCE = 1e-4


class StaticOrBacklash(NamedTuple):
    """Static or backlash: a static curve has all harmonics in phase with the inner sine, whatever its degree.

    p: of every sine, that its harmonics are those of a curve; moving: whether its output moves at all; ambiguous: whether a
    phase π/2 away explains it as well, as for a curve that is even.
    """

    omega: Annotated[Floats, Quantity("rad/s", ("sine",))]
    amplitude: Annotated[Floats, Quantity("input", ("sine",))]
    p_constant: Annotated[Floats, Quantity("1", ("sine",))]
    p: Annotated[Floats, Quantity("1", ("sine",))]
    moving: tuple[bool, ...]
    ambiguous: tuple[bool, ...]
    statistic: float  # Fisher's −2 Σ ln p over the sines that move
    dof: int
    p_static: float
    backlash: bool

    def table(self) -> Table:
        """Return one row a sine and the verdict."""
        rows = tuple(
            (float(f"{w:.6g}"), float(f"{u:.6g}"), float(f"{c:.3g}"), float(f"{p:.3g}") if m else None,
             "moves" if m else "constant")
            for w, u, c, p, m in zip(self.omega, self.amplitude, self.p_constant, self.p, self.moving, strict=True)
        )  # fmt: skip
        verdict = "backlash: no static curve makes these harmonics" if self.backlash else "a static curve explains them"
        note = (
            f"{verdict} (p = {self.p_static:.3g} over all sines)"
            if self.dof
            else "the output does not move: nothing to tell"
        )
        columns = ("ω, rad/s", "amplitude", "p constant", "p static", "output")
        return Table("Static or backlash?", columns, rows, (note,))

    def metrics(self) -> dict[str, float]:
        """Return `static.p`, below 1e-4 where no static curve makes the harmonics."""
        return {"static.p": self.p_static}


def static_or_backlash(
    omega: Floats, drive: Sequence[complex], harmonics: Sequence[Harmonics], degree: int, significance: float = SIGNIFICANCE
) -> StaticOrBacklash:
    """Test whether each sine's output is a curve over some phase of it: Im(Y_k e^{−jkψ}) = 0 for all k at one ψ.

    Of any degree, so that a curve steeper than `degree` is no backlash; of all sines together by Fisher's method at
    `significance`. A sine whose output is constant says nothing. Source [Giri], Proposition 1; [PAPERS D, bar D4].
    """
    from scipy.special import chdtrc

    p_constant, p, moving, ambiguous = [], [], [], []
    for phasor, found in zip(drive, harmonics, strict=True):
        constant = constant_test(found, orders=min(HIGHEST, len(found.order) - 1))
        moves = constant.p < significance
        p_constant.append(constant.p)
        moving.append(bool(moves))
        most = min(HIGHEST, len(found.order) - 1)
        p.append(_in_phase(found, phasor, most) if moves else 1.0)
        even = static_test(found, min(degree, most), phasor) if moves else None
        ambiguous.append(bool(even is not None and even.ambiguous))
    tested = np.maximum(np.array(p)[np.array(moving)], 1e-300)
    statistic = float(-2 * np.log(tested).sum())
    together = float(chdtrc(2 * len(tested), statistic)) if len(tested) else 1.0
    return StaticOrBacklash(
        np.asarray(omega), np.abs(drive), np.array(p_constant), np.array(p), tuple(moving), tuple(ambiguous), statistic,
        2 * len(tested), together, together < significance,
    )  # fmt: skip


def _in_phase(found: Harmonics, drive: complex, most: int) -> float:
    """Return p of the quadrature parts at the best phase, the one that all harmonics give together."""
    best = static_test(found, most, drive, orders=most)
    k = np.arange(1, most + 1)
    turned = found.value[k] * np.exp(-1j * k * (np.angle(drive) + best.phase))
    floor = ROUNDING * float(np.abs(found.value).max())
    dof = np.ones(most, np.intp)
    std = np.hypot(found.own_std[k], floor)
    dof[int(np.argmax((k * turned.real / std) ** 2))] -= 1
    return noise_test(turned.imag**2, dof, std, found.own_lines).p
