"""[Brouri2019], Figure 4.4 and (4.2a): the estimated points on the true f, and the polynomial through those on [1, 3]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from whid.blocks.piecewise import Piecewise
from whid.fit import Estimate, linear_least_squares
from whid.papers._brouri2019 import LOST, one_run, true_curve
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.quantity import Measured
from whid.result import Check
from whid.signal import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WITHIN = (1.0, 3.0)
DEGREE = 3  # of the paper's decomposition


@dataclass(frozen=True, kw_only=True)
class Brouri2019Figure44(Exhibit):
    """Points (U_k, f̂(U_k)) against f, and the cubic (4.2a) through those on [1, 3] ([Brouri2019], Figure 4.4).

    paper's method  the mean of each hold; a cubic through five of them
    efficient       the pieces of the joint fit: a quadratic, as the data say, from levels and sines
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return a row a level and a row a coefficient of (4.2a)."""
        f, run = true_curve(bench), one_run(bench)
        curve = run.stages["static_curve"]
        means = [Measured(float(m), float(s)) for m, s in zip(curve.mean, curve.mean_std, strict=True)]
        points = [
            Row(f"f({u:g})", None, mean, None, float(f.value(np.array([u]))[0]))
            for u, mean in zip(curve.level, means, strict=True)
        ]
        cubic = cubic_through(curve)
        true = np.array(f.pieces[int(np.searchsorted(f.breaks, np.mean(WITHIN)))] + (0.0,) * (DEGREE + 1))[: DEGREE + 1]
        coefficients = [
            Row(
                f"c{k} of (4.2a)", self.printed(f"c{k}"), Measured(float(cubic.values[k]), float(cubic.std[k])),
                _joint(run, f"chain.1.pieces.{_piece(run)}.{k}"), float(true[k]),
            )
            for k in range(DEGREE + 1)
        ]  # fmt: skip
        off = np.array([self.printed(f"c{k}") or np.nan for k in range(DEGREE + 1)]) - true
        worst = max(abs(m.value - float(f.value(np.array([u]))[0])) / m.std for u, m in zip(curve.level, means, strict=True))
        return Regenerated(
            "Figure 4.4 and (4.2a) of Brouri, Rabyi and Ouannou (2019): estimated points on f, and the polynomial on [1, 3]",
            [*points, *coefficients],
            (
                LOST,
                "(4.2b), 31.25 v² - 25, is the true f of the paper on [1, 3]. (4.3) loses the sign of c3 = -0.003.",
                *_judged(off, cubic),
            ),
            (Check("largest |z| of a level", float(worst), below=4.0),),
            lambda figure: _draw(figure, f, curve, cubic),
            ("published", "paper's method, ours", "joint fit, ours", "true"),
        )


def cubic_through(curve: Any) -> Estimate:
    """Return the least-squares cubic through the levels on [1, 3], weighted by their standard errors."""
    inside = (curve.level >= WITHIN[0]) & (curve.level <= WITHIN[1])
    design = np.vander(curve.level[inside], DEGREE + 1, increasing=True)
    return linear_least_squares(design, curve.mean[inside], 1 / curve.mean_std[inside])


def _piece(run: Any) -> int:
    found = next(block for block in run.model.system.chain if isinstance(block, Piecewise))
    return int(np.searchsorted(found.breaks, np.mean(WITHIN)))


def _joint(run: Any, name: str) -> Measured | str:
    estimate = run.model.estimate
    if name not in estimate.names:
        return "none: degree 2 is enough"
    place = estimate.names.index(name)
    return Measured(float(estimate.values[place]), float(estimate.std[place]))


def _judged(off: Floats, cubic: Estimate) -> tuple[str, ...]:
    """Return what the printed coefficients say of themselves: their errors together, in units of ours."""
    if not np.all(np.isfinite(off)):
        return ()
    each = ", ".join(f"c{k} {abs(e) / s:.2g}" for k, (e, s) in enumerate(zip(off, cubic.std, strict=True)))
    chi2 = float(off @ np.linalg.solve(cubic.covariance, off))
    return (
        f"The printed errors, over the standard errors of a cubic through our five levels: {each}; with their correlations "
        f"chi-square of 4 is {chi2:.3g} (95 % below 9.5). How long the paper holds a level is not given.",
    )


def _draw(figure: Figure, f: Piecewise, curve: Any, cubic: Estimate) -> None:
    """Draw f and the points; below, what separates them on [1, 3], with the cubic."""
    from whid.plots._style import MEASURED, MODEL, TRUTH

    figure.set_size_inches(7.4, 6.4)
    above, below = figure.subplots(2, 1, height_ratios=(1.5, 1))
    v = np.linspace(float(curve.level.min()), float(curve.level.max()), 3001)
    w = f.value(v)
    w[np.searchsorted(v, [b for b, kink in zip(f.breaks, f.kinks(), strict=True) if not kink])] = np.nan
    above.plot(v, w, color=TRUTH, ls="--", label="true f")
    above.plot(curve.level, curve.mean, "o", color=MEASURED, mfc="white", ms=5, label="estimated points")
    above.set_title("Figure 4.4, redrawn: estimated points and true f")
    above.set_ylabel("f(v)")
    above.legend(loc="upper left")
    inside = (curve.level >= WITHIN[0]) & (curve.level <= WITHIN[1])
    x = np.linspace(*WITHIN, 201)
    rows = np.vander(x, DEGREE + 1, increasing=True)
    half = 1.96 * np.sqrt(np.einsum("np,pq,nq->n", rows, cubic.covariance, rows))
    cubic_off = rows @ cubic.values - f.value(x)
    below.fill_between(x, cubic_off - half, cubic_off + half, color=MODEL, alpha=0.2, lw=0)
    below.plot(x, cubic_off, color=MODEL, label="cubic (4.2a), 95 % band")
    level = curve.level[inside]
    off = curve.mean[inside] - f.value(level)
    below.errorbar(level, off, 1.96 * curve.mean_std[inside], fmt="o", color=MEASURED, mfc="white", label="points, 95 %")
    below.axhline(0, color=TRUTH, ls="--", lw=1.2)
    below.set_ylabel("minus true f")
    below.set_xlabel("v")
    below.legend(loc="best", ncols=2)
    figure.tight_layout()
