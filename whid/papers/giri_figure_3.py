"""[Giri], Figure 3: a backlash whose loop closes without constant stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge

from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._giri import BRANCH, LOST, Numbers, draw_sine, seen, stages_of
from whid.papers._monte_carlo import held
from whid.quantity import Measured
from whid.signal import Floats
from whid.stages._hysteresis import other_branch
from whid.stages.constant_stages import flat_stretches
from whid.stages.joint_loops import wrapped
from whid.stages.linked_loop import linked_loop
from whid.stages.lissajous import carried
from whid.stages.separable_borders import separable_borders
from whid.stages.static_or_backlash import static_or_backlash


@dataclass(frozen=True, kw_only=True)
class GiriFigure3(Exhibit):
    """Phase and borders of a sine whose loop has no constant stage, by separable least squares ([Giri], Figure 3).

    f_a − f_d = c(x² − X²) with X what the sine reaches. The phase cannot be read off then, and the output looks like that of
    a static curve; the harmonics tell it from one.

    experiment  which of the study's, from 0
    """

    experiment: Annotated[int, Ge(0)] = 0

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return phase and borders, the number of stages, and the verdict static or backlash."""
        one = seen(bench, self.experiment, 30)
        swing, true, degree = one.swing, one.truth, len(one.truth.rising) - 1
        linked = linked_loop(swing.mean, swing.std, degree, swing.omega, swing.amplitude, swing.drive).estimate
        numbers, spread = carried(lambda x: _figures(x, true.phase), linked.values, linked.covariance)
        ours = [Measured(float(v), float(s)) for v, s in zip(numbers, np.sqrt(np.diag(spread)), strict=True)]
        paper = separable_borders([swing], degree).row(0)
        if abs(wrapped(np.array([paper.phase - true.phase]))[0]) > np.pi / 2:
            paper = other_branch(paper)
        theirs = [Measured(true.phase + float(wrapped(np.array([paper.phase - true.phase]))[0]), paper.phase_std)]
        for values, errors in ((paper.rising, paper.rising_std), (paper.falling, paper.falling_std)):
            theirs += [Measured(float(v), float(s)) for v, s in zip(values, errors, strict=True)]
        powers = range(degree + 1)
        names = ["phase, rad", *(f"{side} border, power {k} of x/X" for side in ("rising", "falling") for k in powers)]
        rows = [Row(n, None, p, o, t) for n, p, o, t in zip(names, theirs, ours, _values(true), strict=True)]
        flat, step = flat_stretches(swing), 2 * np.pi / len(swing.mean)
        verdict = static_or_backlash(np.array([swing.omega]), [swing.drive], [one.harmonics], degree)
        rows += [
            Row("longest constant stage, rad of the sine", None, step * flat.first, None, float(stages_of(true).max())),
            Row("static or backlash", None, None, "backlash" if verdict.backlash else "static", "backlash"),
        ]
        reach = np.abs(np.array([o.value for o in ours[1:]]) - _values(true)[1:]) / np.array([o.std for o in ours[1:]])
        fit = Numbers.of(linked.values).near(true.phase)
        title = f"Figure 3, redrawn: limit cycle without constant stages, {swing.omega:.4g} rad/s, U = {swing.amplitude:.4g}"
        return Regenerated(
            "Figure 3 of Giri et al.: a backlash whose loop closes without constant stages", rows,
            (LOST, BRANCH, f"X = U|G| = {one.size:.4g}; at another amplitude the same borders make stages.",
             "What is read off as a stage is the top of the sine, flat to noise: the phase is not where it begins."),
            (held("largest error of the borders over its standard error", Measured(float(reach.max()), 0.0), below=4.0),),
            lambda figure: draw_sine(figure, one, fit, title),
            ("published", "separable, (25)", "whole period, ours", "truth"),
        )  # fmt: skip


def _values(numbers: Numbers) -> list[float]:
    return [numbers.phase, *map(float, numbers.rising), *map(float, numbers.falling)]


def _figures(x: Floats, phase: float) -> Floats:
    return np.array(_values(Numbers.of(x).near(phase)))
