"""Wiener with a backlash: a linear block, then a backlash bordered by polynomials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge

from whid.errors import WhidError
from whid.methods import _loops as loops
from whid.methods._method import Method, Stages
from whid.record import Record, time_constants
from whid.stages._hysteresis import Lumped, Swing
from whid.stages.constant_stages import constant_stages
from whid.stages.joint_loops import JointLoops, joint_loops
from whid.stages.linked_loop import linked_loop
from whid.stages.paper_borders import paper_borders
from whid.stages.separable_borders import SeparableBorders, separable_borders
from whid.stages.static_curve_fit import static_curve_fit
from whid.stages.static_or_backlash import StaticOrBacklash, static_or_backlash
from whid.stages.transfer_function import TransferFunction, transfer_function
from whid.system import System

FREE = 1.0  # standard error of the common log gain that a fit of G(s) leaves open: borders and gain share a scale
LEAST = 1e-6  # standard error at least: what noise-free data leave of arithmetic
FEWEST = 3  # frequencies for a transfer function


@dataclass(frozen=True, kw_only=True)
class WienerBacklash(Method):
    """A linear block, then a backlash between two polynomial borders (or one static curve), from sines about zero.

    x = G·u,  w follows rising(x) while x rises, falling(x) while it falls, and holds on the way between; y = w + noise.
    As in the paper, one sine at a time: constant stages and least squares (23), separable least squares (24)-(25), gain and
    borders (35)-(37), corrected. Beside it whole periods, the stages linked to the borders, sine by sine, then all at once,
    which no unbiased estimate beats. A test on the harmonics tells a static curve from a backlash. At the end G(s), so that
    the model simulates. Source [Giri].

    degree        n, of the borders
    nonlinearity  auto: by the test; static or backlash: known
    whole_record  end with a fit of all numbers to all samples, transients included
    """

    degree: Annotated[int, Ge(1)] = 3
    nonlinearity: Literal["auto", "static", "backlash"] = "auto"
    whole_record: bool = False

    def __call__(self, records: Sequence[Record], model: System | None = None) -> Stages:
        """Yield settled periods, their noise, the verdict, the paper's stages, one sine each, all sines, G(s), the Model."""
        sines, left_out = loops.gather(records)
        if not sines:
            raise WhidError("method-no-sines", "; ".join(("no sine about zero with two settled periods", *left_out)))
        yield loops.settled(sines)
        yield loops.colour(sines)
        verdict = static_or_backlash(
            np.array([s.swing.omega for s in sines]),
            [s.swing.drive for s in sines],
            [s.harmonics for s in sines],
            self.degree,
        )
        yield verdict
        swings = [sine.swing for sine, moves in zip(sines, verdict.moving, strict=True) if moves]
        if not swings:
            raise WhidError("method-constant-output", f"none of {len(sines)} sines moves the output")
        static = self.nonlinearity == "static" or (self.nonlinearity == "auto" and not verdict.backlash)
        if static and all(even for even, moves in zip(verdict.ambiguous, verdict.moving, strict=True) if moves):
            raise WhidError("method-even-curve", "the curve is even about zero: phases are known modulo π/2 only")
        stages = constant_stages(swings, self.degree)
        yield stages
        if not static and all(stages.half):
            raise WhidError(
                "method-one-sided",
                f"through one half of each of {len(swings)} sines the output holds: one border is never met",
            )
        separable = separable_borders(swings, self.degree)
        yield separable
        yield paper_borders([separable.row(k) for k in range(len(swings))])
        if static:
            ones: list[Lumped] = [static_curve_fit(swing, self.degree) for swing in swings]
        else:
            ones = []
            for k, swing in enumerate(swings):
                one = linked_loop(swing.mean, swing.std, self.degree, swing.omega, swing.amplitude, swing.drive)
                yield one
                ones.append(self._better(Lumped(*one[:8]), one.estimate.reduced_chi2, separable, k))
        joint = joint_loops(swings, ones, self.degree, static=static)
        yield joint
        if not static:
            yield loops.admissible(swings, joint)
        yield from self._finished(records, swings, joint, verdict, left_out)

    def _better(self, one: Lumped, chi2: float, separable: SeparableBorders, k: int) -> Lumped:
        """Return the separable borders where the linked loop does not explain a sine that has no constant stage."""
        worse = chi2 > 1.5 * separable.reduced_chi2[k] and not separable.stages[k]
        return separable.row(k) if worse else one

    def _finished(
        self,
        records: Sequence[Record],
        swings: Sequence[Swing],
        joint: JointLoops,
        verdict: StaticOrBacklash,
        left_out: tuple[str, ...],
    ) -> Stages:
        """Yield G(s), its fit together with the borders, the whole-record fit where wanted, and the Model."""
        said = [*left_out, *loops.one_sided(swings, joint)]
        if silent := verdict.moving.count(False):
            said.append(f"{silent} sine{'s' * (silent > 1)} left out: the output does not move")
        if not joint.resolved:
            said.append("the branch of some frequency is open: its phase may be π off")
        said.append("(G, F[x]) and (−G, F[−x]) are the same system: G(0) > 0 by convention, and 1 by scale")
        if len(joint.omega) < FEWEST:
            raise WhidError("method-few-frequencies", f"{len(joint.omega)} frequencies: too few for a transfer function")
        linear = self._linear(swings, joint, time_constants(records))
        yield linear
        found = loops.parametric(swings, joint, linear)
        yield found
        if not (np.isfinite(found.estimate.chi2) and found.estimate.reduced_chi2 < 1.5 * joint.estimate.reduced_chi2 + 0.5):
            said.append("no transfer function explains the frequency response: the model simulates the nearest one")
        staged = loops.model_of(found, linear, static=joint.static, missing=tuple(said))
        if not self.whole_record:
            yield staged
            return
        try:
            whole, final = loops.refined(staged, records)
        except (WhidError, ValueError, np.linalg.LinAlgError) as fault:
            yield staged._replace(missing=(*staged.missing, f"the whole-record fit failed: {fault}"))
            return
        yield whole
        yield final

    def _linear(self, swings: Sequence[Swing], joint: JointLoops, shown: tuple[float, float]) -> TransferFunction:
        count = len(joint.omega)
        covariance = joint.covariance.copy()
        covariance[:count, :count] += FREE**2
        covariance += LEAST**2 * np.eye(2 * count)
        log_gain = np.log(joint.gain / joint.gain[0])
        samples = sum(len(s.mean) * s.periods for s in swings)
        return transfer_function(
            joint.omega,
            log_gain,
            np.unwrap(joint.phase),
            covariance,
            samples,
            highest=min(4, (2 * count - 1) // 2),
            shown=shown,
        )
