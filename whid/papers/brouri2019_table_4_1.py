"""[Brouri2019], Table 4.1: gains and phases of both linear blocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from whid.methods._borders import unit_gain
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._monte_carlo import held, rmse
from whid.quantity import Measured
from whid.record import Record
from whid.refine import bound
from whid.result import Check, Result
from whid.score import linear_gain
from whid.signal import Floats
from whid.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPWISE = {"front.gain@0.02": 7e-4, "front.gain@0.04": 8e-4, "front.gain@0.06": 9e-4}  # bar A5
OBSERVED = 0.5  # of the runs that must have a number: a harmonic that f does not make stands out of the noise now and then
GAIN, PHASE = 0.003, 0.010  # bar A6, rad


@dataclass(frozen=True, kw_only=True)
class Brouri2019Table41(Exhibit):
    """Gains and phases of both linear blocks in one run, and their errors over many ([Brouri2019], Table 4.1).

    paper's method  |G| step by step from (3.24), (4.4b), (4.5); it gives no phase that does not depend on a choice
    efficient       joint rational fit of levels and harmonics, which fixes the phase's gauge
    bound           Cramér-Rao, all numbers of the plant unknown, all samples
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return each printed number beside one run's, then its printed error beside the RMSE over all runs."""
        assert bench.plant is not None
        staged: Any = bench.method
        changes = {"identify": replace(staged, whole_record=False)}
        one = next(bench.results(1, **changes))
        found = bench.metrics(**changes)
        names = [row.quantity for row in self.published]
        truth = {name: gains(bench.plant, [name])[0] for name in names}
        least = bounds(bench.plant, one.records[0], names)
        values = [_one_run(name, self.printed(name), one) for name in names]
        errors = [self._errors(name, found, truth[name], least[name]) for name in names]
        off = {row.quantity: abs(row.efficient.value - truth[row.quantity]) / row.efficient.std
               for row in values if isinstance(row.efficient, Measured)}  # fmt: skip
        report = one.stages.get("identifiability")
        return Regenerated(
            "Table 4.1 of Brouri, Rabyi and Ouannou (2019): one run, then errors over "
            f"{bench.runs} runs (published: of the one run that was printed)",
            [*values, *errors],
            (
                "The paper's captions call it Table 2.1. Its |Gi(j0.02)| = 0.97 is 0.979.",
                "f outside [1, 3] is our own choice, the figures that show it are lost.",
                "bound: Cramér-Rao of all samples, structure known; the joint fit sees levels and harmonics on [1, 3] only.",
                "A delay may sit in either block: phases are those of the rational form, nothing else fixes them.",
                *getattr(report, "not_measured", ()),
            ),
            tuple(_bars(errors, off)),
            lambda figure: _draw(figure, errors),
        )  # fmt: skip

    def _errors(self, name: str, found: Mapping[str, Floats], truth: float, least: float) -> Row:
        printed = self.printed(name)
        off = None if printed is None else abs(printed - truth)
        paper, ours = (
            rmse(found[key][:, 0] - truth) if key in found and np.isfinite(found[key][:, 0]).mean() > OBSERVED else None
            for key in (f"paper.{name}", name)
        )
        return Row(f"error of {name}", off, paper, ours or "not observed", least if ours else None)


def gains(system: System, names: list[str]) -> list[float]:
    """Return gains and phases, named as `front.gain@0.02`, of a system's linear blocks at static gain 1."""
    found = []
    for name in names:
        block, quantity, omega = name.replace("@", ".", 1).split(".", 2)
        g = complex(linear_gain(system, block, np.array([float(omega)]))[0])
        found.append(float(abs(g) if quantity == "gain" else np.angle(g)))
    return found


def bounds(plant: System, record: Record, names: list[str]) -> dict[str, float]:
    """Return the Cramér-Rao bound of gains and phases: that of the plant's numbers, by central differences."""
    noise: Any = plant.noise[0]
    least = bound(plant, [record], [noise.std], fixed=unit_gain(plant))
    steps = 1e-5 * np.maximum(np.abs(least.values), 1e-3)
    slopes = []
    for k, step in enumerate(steps):
        sides = []
        for sign in (1, -1):
            moved = {least.names[k]: float(least.values[k] + sign * step)}
            sides.append(gains(replace(plant, chain=plant.tree.with_parameters(moved).chain), names))
        slopes.append((np.array(sides[0]) - sides[1]) / (2 * step))
    gradient = np.array(slopes).T
    return dict(zip(names, np.sqrt(np.einsum("np,pq,nq->n", gradient, least.covariance, gradient)).tolist(), strict=True))


def _one_run(name: str, printed: float | None, one: Result) -> Row:
    return Row(name, printed, one.metrics.get(f"paper.{name}"), one.metrics.get(name, "not observed"))


def _bars(errors: list[Row], off: Mapping[str, float]) -> list[Check]:
    bars = [Check("A6 largest |z| of one run", max(off.values(), default=None), below=4.0)]
    for row in errors:
        name = row.quantity.removeprefix("error of ")
        if isinstance(row.efficient, Measured):
            bars.append(held(f"A6 RMSE of {name}", row.efficient, below=GAIN if ".gain" in name else PHASE))
        if name in STEPWISE and isinstance(row.paper, Measured):
            bars.append(held(f"A5 stepwise RMSE of {name}", row.paper, below=STEPWISE[name]))
    return bars


def _draw(figure: Figure, errors: list[Row]) -> None:
    """Draw errors over quantities: what was printed lies far above what noise explains."""
    from whid.plots._style import MEASURED, MODEL, OTHER, TRUTH

    figure.set_size_inches(7.4, 5.2)
    axes = figure.subplots()
    place = np.arange(len(errors))
    styles = {"published": ("x", TRUTH, "printed"), "paper": ("s", OTHER, "paper's method, ours"),
              "efficient": ("o", MODEL, "joint rational, ours"), "bound": ("_", MEASURED, "Cramér-Rao bound")}  # fmt: skip
    for column, (marker, colour, label) in styles.items():
        cells = [getattr(row, column) for row in errors]
        size = np.array([c.value if isinstance(c, Measured) else c if isinstance(c, float) else np.nan for c in cells])
        axes.plot(place, size, marker, color=colour, label=label, mfc="none" if marker == "s" else colour, ms=6)
    axes.set_yscale("log")
    axes.set_xticks(place, [row.quantity.removeprefix("error of ") for row in errors], rotation=60, ha="right", fontsize=8)
    axes.set_ylabel("error: of the printed run; RMSE over ours")
    axes.set_title("Table 4.1: the printed errors are not those of the noise")
    axes.legend(loc="upper left", ncols=2)
    axes.set_ylim(top=axes.get_ylim()[1] * 6)
    figure.tight_layout()
