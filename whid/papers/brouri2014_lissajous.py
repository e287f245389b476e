"""[Brouri2014], Propositions 1-2: the Lissajous family over δ, and the phase at which it is a curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from whid.papers._brouri2014 import OWN_PLANT, PERIODS, SAMPLES, Shot, shoot
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._monte_carlo import held, rmse
from whid.quantity import Measured
from whid.score import linear_response
from whid.signal import Floats
from whid.stages.static_test import lissajous_cost

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AWAY = (-0.9, -0.4, -0.15, 0.0, 0.15, 0.4)  # rad, of δ from the phase, one panel each


@dataclass(frozen=True, kw_only=True)
class Brouri2014Lissajous(Exhibit):
    """Output against A sin(ωt − δ) for several δ: a static curve at one of them ([Brouri2014], Propositions 1-2, Table 1).

    paper's method  the δ at which the enclosed area vanishes, which is the phase of the fundamental
    efficient       the δ at which all harmonics agree
    """

    offset: float = 1.1
    amplitude: float = 0.45
    omega: float = 1.0

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return the phase of one run, its RMSE over all runs, and where the static test draws the line."""
        plant: Any = bench.plant
        degree = len(plant.chain[-1].coefficients) - 1
        true = float(np.angle(linear_response(plant, np.array([self.omega]))[0]))
        shots = []
        for k in range(bench.runs):
            shots.append(shoot(plant, self.offset, self.amplitude, self.omega, degree, bench.rng(2, k)))
            bench.watch(k + 1, bench.runs)
        first = shots[0]
        area, joint = (np.array([_folded(at(shot) - true) for shot in shots]) for at in (_fundamental, _joint))
        orders = np.arange(1, degree + 1)
        std = plant.noise[0].std * np.sqrt(2 / (SAMPLES * PERIODS))
        least = float(std / np.sqrt(np.sum((orders * np.mean([s.static.along[1:] for s in shots], axis=0)) ** 2)))
        y = first.harmonics
        alone = Measured(true + float(area[0]), float(y.value_std[1] / abs(y.value[1])))
        size = rmse(joint)
        rows = [
            Row("phase of one run, rad", None, alone, Measured(true + float(joint[0]), first.static.phase_std), true),
            Row(f"RMSE over {bench.runs} runs, rad", None, rmse(area), size, least),
            Row("p of the static test there", None, None, first.static.p, tolerance=0.02),
        ]
        return Regenerated(
            "The Lissajous family of Brouri, Amdouri, Chaoui and Giri (2014)",
            rows,
            (
                OWN_PLANT,
                "The area that the curve encloses is that of the fundamental alone: where it vanishes says nothing of the "
                "other harmonics, which tell the phase as well.",
            ),
            (held("C1 RMSE over bound", Measured(size.value / least, size.std / least), below=1.15, above=0.85),),
            lambda figure: _draw(figure, first, degree, true),
            ("published", "area vanishes", "all harmonics agree", "truth, or bound"),
        )


def _fundamental(shot: Shot) -> float:
    return float(np.angle(shot.harmonics.value[1])) + np.pi / SAMPLES  # the held sine is half a sample late


def _joint(shot: Shot) -> float:
    return shot.static.phase + 0.0


def _folded(x: float) -> float:
    return float((x + np.pi / 2) % np.pi - np.pi / 2)


def _draw(figure: Figure, shot: Shot, degree: int, true: float) -> None:
    """Draw the averaged output against shifted sines, then the criterion over δ."""
    from whid.plots._style import MODEL, OTHER, TRUTH

    figure.set_size_inches(7.4, 6.4)
    grid = figure.add_gridspec(3, 3, height_ratios=(1, 1, 1.1))
    turn = 2 * np.pi * np.arange(401) / 400
    order = shot.harmonics.order[:11]
    y = np.real(np.exp(1j * np.outer(turn, order)) @ shot.harmonics.value[:11])
    for k, away in enumerate(AWAY):
        axes = figure.add_subplot(grid[k // 3, k % 3])
        z: Floats = shot.amplitude * np.cos(turn - np.pi / SAMPLES + true - away)
        axes.plot(z, y, color=MODEL if away else OTHER)
        axes.set_title(f"δ = φ {'+' if away >= 0 else '−'} {abs(away):g}" if away else "δ = φ")
        if k % 3 == 0:
            axes.set_ylabel("output")
    below = figure.add_subplot(grid[2, :])
    phase = true + np.linspace(-np.pi / 2, np.pi / 2, 801)
    drive = np.exp(-1j * np.pi / SAMPLES)
    below.semilogy(phase, lissajous_cost(shot.harmonics, degree, phase, drive), color=MODEL)
    below.axvline(true, color=TRUTH, ls="--", lw=1.1, label="true phase")
    below.set_xlabel("phase tried, rad")
    below.set_ylabel("χ² of a static curve")
    below.legend(loc="lower left")
    figure.tight_layout()
