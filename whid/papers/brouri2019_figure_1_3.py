"""[Brouri2019], Figure 1.3: an orthogonal polynomial decomposition rings at the jumps of a hard nonlinearity."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from whid.blocks.piecewise import Piecewise
from whid.papers._brouri2019 import LOST, true_curve
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.signal import Floats
from whid.stages._chebyshev import Domain, evaluate, scaled, unscaled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOMAIN = (-3.5, 4.0)  # that of the staircase
DEGREES = (10, 20, 40, 80, 160, 320)
SHOWN = (10, 40, 160)
JUMP = 1  # the largest: the second break
GIBBS = 0.0894898722  # overshoot over jump of a Fourier series, (1/π)∫₀^π sin t/t dt − 1/2


@dataclass(frozen=True, kw_only=True)
class Brouri2019Figure13(Exhibit):
    """The rings of a Chebyshev decomposition of a hard function, degree by degree ([Brouri2019], Figure 1.3)."""

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return overshoot and rms error of every degree; nothing here is random."""
        f = true_curve(bench)
        series = {degree: decomposed(f, degree, DOMAIN) for degree in DEGREES}
        height, at = float(f.jumps()[JUMP]), float(f.breaks[JUMP])
        right = np.linspace(at, f.breaks[JUMP + 1], 20_001)[1:-1]
        every = unscaled(np.cos((np.arange(20_000) + 0.5) * np.pi / 20_000), DOMAIN)
        rows = []
        for degree, c in series.items():
            over = float((evaluate(scaled(right, DOMAIN), c) - f.value(right)).max() / height)
            rows.append(Row(f"overshoot over the jump at {at:g}, degree {degree}", None, over, None, GIBBS))
        for degree, c in series.items():
            error = evaluate(scaled(every, DOMAIN), c) - f.value(every)
            rows.append(Row(f"rms error, Chebyshev weight, degree {degree}", None, float(np.sqrt(np.mean(error**2)))))
        return Regenerated(
            "Figure 1.3 of Brouri, Rabyi and Ouannou (2019): a Chebyshev series of a hard function rings at its jumps",
            rows,
            (
                LOST,
                "The overshoot does not die with the degree, it only moves closer: it tends to 8.95 % of a jump (Gibbs). "
                "The rms error falls as 1/√degree.",
                "The same f as pieces has five polynomials of degree 2 at most and no ring: Figures 4.1 and 4.4.",
            ),
            draw=lambda figure: _draw(figure, f, series),
            headings=("published", "decomposition", "efficient, ours", "limit of the overshoot"),
        )


def decomposed(f: Piecewise, degree: int, domain: Domain) -> Floats:
    """Return the Chebyshev coefficients (2/π)∫₀^π f(cos θ) cos kθ dθ, piece by piece by Gauss-Legendre in θ."""
    edges = np.arccos(np.clip(scaled(np.array([domain[1], *f.breaks[::-1], domain[0]]), domain), -1, 1))
    nodes, weights = np.polynomial.legendre.leggauss(degree // 2 + 40)
    total = np.zeros(degree + 1)
    for low, high in pairwise(edges):
        theta = (low + high) / 2 + nodes * (high - low) / 2
        values = f.value(unscaled(np.cos(theta), domain)) * weights * (high - low) / 2
        total += np.cos(np.arange(degree + 1)[:, None] * theta) @ values * 2 / np.pi
    total[0] /= 2
    return total


def _draw(figure: Figure, f: Piecewise, series: dict[int, Floats]) -> None:
    """Draw f and some decompositions; below, the neighbourhood of the largest jump."""
    from whid.plots._style import MODEL, OTHER, QUIET, TRUTH

    figure.set_size_inches(7.4, 6.4)
    at = f.breaks[JUMP]
    for axes, (low, high) in zip(figure.subplots(2, 1), (DOMAIN, (at - 0.5, at + 0.6)), strict=True):
        v = np.linspace(low, high, 4001)
        for degree, colour in zip(SHOWN, (QUIET, OTHER, MODEL), strict=True):
            axes.plot(v, evaluate(scaled(v, DOMAIN), series[degree]), color=colour, lw=1.0, label=f"degree {degree}")
        true = f.value(v)
        true[np.searchsorted(v, [b for b in f.breaks if low < b < high])] = np.nan
        axes.plot(v, true, color=TRUTH, lw=1.6, label="f")
        axes.set_ylabel("f(v)")
    first, second = figure.axes
    first.set_title("Figure 1.3, redrawn: a Chebyshev series rings at the jumps")
    second.set_title(f"at the jump of {f.jumps()[JUMP]:g}")
    second.set_xlabel("v")
    first.legend(loc="upper left", ncols=2)
    figure.tight_layout()
