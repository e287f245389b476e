"""[Giri], Proposition 1(3): a larger amplitude does not always make a constant output move."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from whid.experiments._experiment import Experiment
from whid.experiments.sine import Sine
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._monte_carlo import share
from whid.quantity import Measured
from whid.result import Check, Result

REFUSED = "method-constant-output"


@dataclass(frozen=True, kw_only=True)
class GiriNeverMoves(Exhibit):
    """How many sines move the output of a plant that sticks, and how many runs are refused by name.

    factors  of the study's amplitudes
    """

    factors: tuple[float, ...] = (1.0, 4.0, 16.0)

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return two rows a factor; a bar on each share of refused runs."""
        rows, bars = [], []
        for factor in self.factors:
            larger = tuple(_larger(one, factor) for one in bench.experiments)
            runs = list(bench.results(experiment=larger))
            refused, moving = _refused(runs), _moving(runs)
            rows.append(
                Row(f"sines that move the output, at {factor:g} × the amplitudes", None, None, moving, 0, tolerance=0.01)
            )
            rows.append(Row(f"runs refused at {factor:g} ×: the output is constant", None, None, refused, 1, tolerance=0.01))
            # one sine in 1e4 is taken for moving by chance
            bars.append(Check(f"refused at {factor:g} ×", refused.value, above=0.9))
        bench.failures.clear()  # they are the result
        return Regenerated(
            f"A backlash that never moves (Giri et al., Proposition 1(3)): {bench.runs} runs an amplitude", rows,
            ("The paper: admissibility can always be recovered by increasing U. Where f_a lies above f_d, the "
             "other border is below what is held when the sine turns and moves away from it: the output sticks for ever.",
             f"Each run is refused by name, {REFUSED}, with what to try."),
            tuple(bars), headings=("published", "paper's method, ours", "share found", "truth"),
        )  # fmt: skip


def _larger(experiment: Experiment, factor: float) -> Experiment:
    sines = [replace(part, amplitude=factor * part.amplitude) for part in experiment.parts if isinstance(part, Sine)]
    return replace(experiment, parts=tuple(sines))


def _refused(runs: list[Result]) -> Measured:
    return share(sum(run.error is not None and run.error.code == REFUSED for run in runs), len(runs))


def _moving(runs: list[Result]) -> Measured:
    told = np.concatenate([run.stages["static_or_backlash"].moving for run in runs])
    return share(int(told.sum()), len(told))
