"""[Brouri2014], Figure 3: the curves of the output nonlinearity that sines of several frequencies see."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import polynomial as poly

from whid.papers._brouri2014 import OWN_PLANT, Shot, curve_of, shoot
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.quantity import Measured
from whid.score import linear_response
from whid.signal import Floats
from whid.stages._affine_fit import real_roots
from whid.stages.lissajous import about_zero, carried
from whid.stages.static_test import on_branch

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Brouri2014Figure3(Exhibit):
    """Curves that are f, more or less spread, and moved ([Brouri2014], Figure 3).

    A sine on one piece shows f(X + S|G|z). As printed its zero is at z = −X; it is at −X/(S|G|).
    """

    omega: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0)
    offset: float = 1.1
    amplitude: float = 0.5

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return where each curve crosses zero and its slope there, beside what |G| makes of f."""
        plant: Any = bench.plant
        h, f = plant.chain[0], plant.chain[-1]
        degree = len(f.coefficients) - 1
        shots = [shoot(plant, self.offset, self.amplitude, w, degree, bench.rng(3, k)) for k, w in enumerate(self.omega)]
        steady = [plant.tree.steady(self.offset + away, 1.0)[0] for away in (-0.1 * self.amplitude, 0.1 * self.amplitude)]
        rise = Measured(float(steady[1] - steady[0]), 0.0)  # the staircase tells the branch
        shots = [shot._replace(static=on_branch(shot.static, rise)) for shot in shots]
        inner = h.value(np.array([self.offset, self.offset + self.amplitude]))
        x, slope = float(inner[0]), float((inner[1] - inner[0]) / self.amplitude)
        gains = np.abs(linear_response(plant, np.array(self.omega)))
        rows = []
        for w, shot, g in zip(self.omega, shots, gains, strict=True):
            variance = np.diag(shot.static.along_std**2)
            numbers, covariance = carried(partial(_zero, amplitude=shot.amplitude), shot.static.along, variance)
            at, rate = (Measured(float(v), float(s)) for v, s in zip(numbers, np.sqrt(np.diag(covariance)), strict=True))
            rows.append(Row(f"zero of the curve at {w:.4g} rad/s, from the middle", None, at, None, -x / (slope * g)))
            rows.append(Row(f"slope there at {w:.4g} rad/s", None, rate, None, float(slope * g * f.coefficients[1])))
        note = f"X = {x:.4g}: a shift by X, as printed in (10) and section 4.2, would put all zeros at {-x:.4g}."
        return Regenerated(
            "Figure 3 of Brouri, Amdouri, Chaoui and Giri (2014): f, more or less spread", rows, (OWN_PLANT, note),
            draw=lambda figure: _draw(figure, self.omega, shots, f.coefficients),
            headings=("published", "from its curve", "efficient, ours", "truth"),
        )  # fmt: skip


def _zero(along: Floats, amplitude: float) -> Floats:
    """Return where a curve crosses zero and its slope there."""
    c, root = about_zero(along, amplitude)
    return np.array([root, c[0]])


def _draw(figure: Figure, omega: tuple[float, ...], shots: list[Shot], f: tuple[float, ...]) -> None:
    """Draw the curves as they are seen, then moved to their zeros beside f."""
    from whid.plots._style import MODEL, OTHER, QUIET, TRUTH

    figure.set_size_inches(7.4, 4.2)
    left, right = figure.subplots(1, 2, sharey=True)
    colours = (MODEL, OTHER, "#CC79A7", QUIET)
    for w, shot, colour in zip(omega, shots, colours * len(omega), strict=False):
        c = curve_of(shot)
        zero = real_roots(c)
        at = float(zero[np.argmin(np.abs(zero))])
        z = np.linspace(-shot.amplitude, shot.amplitude, 100)
        beyond = np.linspace(min(at, -shot.amplitude), max(at, -shot.amplitude), 100)
        left.plot(beyond, poly.polyval(beyond, c), color=colour, lw=0.8, ls=":")
        left.plot(z, poly.polyval(z, c), color=colour, label=f"{w:g} rad/s")
        right.plot(z - at, poly.polyval(z, c), color=colour)
        right.plot(beyond - at, poly.polyval(beyond, c), color=colour, lw=0.8, ls=":")
    top = max(line.get_xdata().max() for line in right.get_lines())
    x = np.linspace(0, top, 200)
    right.plot(x, poly.polyval(x, f), color=TRUTH, ls="--", lw=1.1, label="f")
    left.set_title("Curves as sines see them")
    right.set_title("Moved to their zeros: f, more or less spread")
    left.set_xlabel("z from the middle of the sine")
    right.set_xlabel("z from the zero of the curve")
    left.set_ylabel("output")
    left.legend(loc="upper left")
    right.legend(loc="upper left")
    figure.tight_layout()
