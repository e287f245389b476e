"""[Brouri2019], Figures 4.5 and 4.6: the output for a sine, and the estimate of x over one period."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from whid.papers._brouri2019 import Sine, one_run, sine
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.quantity import Measured
from whid.signal import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HARMONICS = 3
PERIODS = 4  # shown of the output
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Brouri2019Figure46(Exhibit):
    """Output for u = 2 + cos(0.02 t) and x̂ over one period ([Brouri2019], Figures 4.5 and 4.6).

    paper's method  (3.25a): the mean of the periods behind the first
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return the harmonics of x̂ and of x."""
        run = one_run(bench)
        shown, found = sine(bench, run.records[0]), run.stages["harmonics"]
        true = np.fft.rfft(shown.true[-shown.period :]) / shown.period
        rows = []
        for k in range(HARMONICS + 1):
            size, std = float(abs(found.value[k])), float(found.value_std[k])
            expected = float(abs(true[k]) * (2 if k else 1))
            expected = expected if expected > ROUNDING * abs(true[0]) else 0.0
            rows.append(Row(f"amplitude of harmonic {k}" if k else "mean", None, Measured(size, std), None, expected))
        average = shown.average(shown.y)
        spread = shown.y[shown.lead * shown.period :].reshape(-1, shown.period) - average
        periods = len(spread)
        noise = float(np.sqrt(np.sum(spread**2) / ((periods - 1) * shown.period)))
        off = float(np.mean((average - shown.average(shown.true)) ** 2) * periods / noise**2)
        rows.append(Row("noise about the mean period, std", None, _error(noise, (periods - 1) * shown.period), None, 0.5))
        chi2 = Measured(off, float(np.sqrt(2 / shown.period)))
        rows.append(Row("mean square of estimate minus x, over noise variance/periods", None, chi2, None, 1))
        return Regenerated(
            "Figures 4.5 and 4.6 of Brouri, Rabyi and Ouannou (2019): output for a sine, estimate of x over one period",
            rows,
            (
                "The figures are lost: redrawn from our plant; on [1, 3], where this sine stays, its f is the paper's.",
                "One period is left out, as (3.25a) does: at 0.02 rad/s, 314 s, that is enough; at higher frequencies it is "
                "not, and whid leaves out as many as the settling time takes.",
                "f is quadratic where v goes: the third harmonic of the 9 phase equations is absent, 0 in truth.",
            ),
            draw=lambda figure: _draw(figure, shown, average),
            headings=("published", "paper's method, ours", "efficient, ours", "true"),
        )


def _error(std: float, dof: int) -> Measured:
    return Measured(std, float(std / np.sqrt(2 * dof)))


def _draw(figure: Figure, shown: Sine, average: Floats) -> None:
    """Draw some periods of y, then x̂ over one, and what separates it from x."""
    from whid.plots._style import MODEL, QUIET, TRUTH

    figure.set_size_inches(7.4, 7.2)
    first, second, third = figure.subplots(3, 1, height_ratios=(1.2, 1.2, 0.8))
    many = slice(0, PERIODS * shown.period)
    first.plot(shown.time[many], shown.y[many], color=QUIET, lw=0.8)
    first.set_title("Figure 4.5, redrawn: output for u = 2 + cos 0.02t")
    first.set_ylabel("y")
    t, x = shown.time[: shown.period], shown.average(shown.true)
    second.plot(t, average, color=MODEL, label="estimate of x, (3.25a)")
    second.plot(t, x, color=TRUTH, ls="--", lw=1.0, label="x")
    second.set_title("Figure 4.6, redrawn: estimate of x over one period")
    second.set_ylabel("x")
    second.legend(loc="upper right")
    third.plot(t, average - x, color=MODEL, lw=0.8)
    third.set_ylabel("estimate - x")
    third.set_xlabel("time, s")
    figure.tight_layout()
