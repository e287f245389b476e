"""The descents of a nonlinear fit, one after another."""

from __future__ import annotations

import time

from whid.fit import Estimate
from whid.methods._windows import Windows
from whid.stages._cascade import Cascade
from whid.stages.cascade_fit import Window, cascade_fit, rms_error
from whid.stages.descent import Step


class Descents:
    """The descents so far, the estimate of the last, and the selection parts that judge between models."""

    def __init__(self, selection: Windows | None) -> None:
        self.steps: list[Step] = []
        self.estimate: Estimate
        self.selection = selection

    def settle(self, lead: int) -> None:
        """Give the selection parts samples in front for the filters to settle."""
        if self.selection is not None:
            self.selection.lead = lead

    def kept(self, factor: int) -> list[Window]:
        """Return the selection parts, none where there are none."""
        return [] if self.selection is None else self.selection.every(factor)

    def down(self, windows: list[Window], start: Cascade, iterations: int = 25) -> Cascade:
        """Fit, and remember what it took."""
        began = time.perf_counter()
        cascade, self.estimate = cascade_fit(windows, start, iterations)
        each = (time.perf_counter() - began) / max(self.estimate.iterations, 1)
        samples, numbers = sum(w.samples for w in windows), sum(len(curve.parameters()) for curve in cascade.curves)
        rms = rms_error(windows, cascade)
        self.steps.append(
            Step(samples, windows[0].factor, numbers, rms, self.estimate.iterations, each, self.estimate.why_stop)
        )
        return cascade
