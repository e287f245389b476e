"""[Giri], Figure 2: a limit cycle with constant stages, and the output that shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge

from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._giri import BRANCH, LOST, Numbers, Seen, draw_sine, seen, stages_of
from whid.quantity import Measured
from whid.signal import Floats
from whid.stages.constant_stages import constant_stages, flat_stretches
from whid.stages.joint_loops import wrapped
from whid.stages.linked_loop import linked_loop
from whid.stages.lissajous import carried
from whid.stages.separable_borders import separable_borders


@dataclass(frozen=True, kw_only=True)
class GiriFigure2(Exhibit):
    """Phase and constant stages of one sine: read off, as the paper does, and by the loop's whole period ([Giri], Figure 2).

    experiment  which of the study's, from 0
    """

    experiment: Annotated[int, Ge(0)] = 4

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return phase and lengths of both stages, with the limit cycle and the output over time."""
        one = seen(bench, self.experiment, 20)
        swing, true, degree = one.swing, one.truth, len(one.truth.rising) - 1
        linked = linked_loop(swing.mean, swing.std, degree, swing.omega, swing.amplitude, swing.drive).estimate
        numbers, spread = carried(lambda x: _figures(x, true.phase), linked.values, linked.covariance)
        ours = [Measured(float(v), float(s)) for v, s in zip(numbers, np.sqrt(np.diag(spread)), strict=True)]
        read, fitted = constant_stages([swing], degree), separable_borders([swing], degree)
        angle = _near(float(read.phase[0]), true.phase)
        lengths = _read(one)
        step = float(read.phase_std[0])
        rows = [
            Row("phase, rad: where a stage begins, (23a)", None, Measured(angle, step), ours[0], true.phase),
            Row("phase, rad: separable, (25a)", None,
                Measured(_near(float(fitted.phase[0]), true.phase), float(fitted.phase_std[0])), None, true.phase),
        ]  # fmt: skip
        for k, name in enumerate(("ωτ_d, stage after the top, rad", "ωτ_a, stage after the bottom, rad")):
            rows.append(Row(name, None, Measured(float(lengths[k]), 2 * step), ours[1 + k], float(stages_of(true)[k])))
        notes = (
            LOST, BRANCH,
            "What is read off has an error of the sampling only, but noise makes a stage look longer than it is: it seems "
            "to begin before the sine turns. The borders say when it ends.",
        )  # fmt: skip
        fit = Numbers.of(linked.values).near(true.phase)
        title = f"Figure 2, redrawn: limit cycle with constant stages, {swing.omega:.4g} rad/s, U = {swing.amplitude:.4g}"
        return Regenerated(
            "Figure 2 of Giri et al.: a limit cycle with constant stages", rows, notes,
            draw=lambda figure: draw_sine(figure, one, fit, title),
            headings=("published", "paper's method, ours", "whole period, ours", "truth"),
        )  # fmt: skip


def _figures(x: Floats, phase: float) -> Floats:
    """Return the phase and the lengths of both stages, from (phase, rising, falling) on either branch."""
    numbers = Numbers.of(x).near(phase)
    return np.append(numbers.phase, stages_of(numbers))


def _near(phase: float, true: float) -> float:
    """Return a phase that is known modulo π within π/2 of another."""
    return float(true + wrapped(np.array([2 * (phase - true)]))[0] / 2)


def _read(one: Seen) -> Floats:
    """Return the stages as they are read off the averaged period, rad: after the top, after the bottom."""
    flat, step = flat_stretches(one.swing), 2 * np.pi / len(one.swing.mean)
    lengths = step * np.array([flat.first, flat.second])
    top = abs(wrapped(np.array([one.swing.angle[flat.start] + one.truth.phase]))[0]) <= np.pi / 2
    return lengths if top else lengths[::-1]
