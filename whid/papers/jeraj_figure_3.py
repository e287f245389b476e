"""[Jeraj and Mathews], Figure 3: power spectra of input, output and error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._jeraj import NOT_GIVEN, curve, decibel, method, spectrum, trials
from whid.quantity import Measured
from whid.signal import Floats, rms
from whid.stages._chebyshev import evaluate, scaled
from whid.stages.chebyshev_fit import chebyshev_fit
from whid.stages.node_windows import node_windows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CASES = ((float("inf"), "no noise"), (20.0, "20 dB"))
EXACT = " (least squares leaves only rounding, below)"
FLOOR = -120.0  # dB, of the picture
SILENT = -200.0  # dB: below is rounding


class Signals(NamedTuple):
    """One record: input, output as measured, and model minus the output without noise, where the curve is known."""

    x: Floats
    y: Floats
    paper: Floats
    efficient: Floats
    true: Floats


@dataclass(frozen=True, kw_only=True)
class JerajFigure3(Exhibit):
    """Power spectra of input, output and error, without noise and at 20 dB ([Jeraj and Mathews], Figure 3)."""

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return the error's power over the output's, mean of the runs in dB; the picture is of the first run."""
        cases = [_signals(bench, snr, 200 + k) for k, (snr, _) in enumerate(CASES)]
        rows = []
        for (_, words), records in zip(CASES, cases, strict=True):
            paper, efficient = ([rms(getattr(r, name)) / rms(r.true) for r in records] for name in ("paper", "efficient"))
            rows.append(Row(f"error power over output power, {words}, dB", None, _decibels(paper), _decibels(efficient)))
        return Regenerated(
            f"Figure 3 of Jeraj and Mathews: error of the model's output in simulation, {bench.runs} runs",
            rows,
            (
                "The figure is lost: redrawn from our runs, nothing of it can be compared.",
                "Error: model minus the output without noise, at all inputs, those beyond [-1, 1] (1 in 370) included.",
                NOT_GIVEN,
            ),
            draw=lambda figure: _draw(figure, [records[0] for records in cases]),
        )


def _signals(bench: Bench, snr: float, key: int) -> list[Signals]:
    options, domain = method(bench)
    found = []
    for x, y, _ in trials(bench, bench.runs, snr, key):
        true, t = curve(bench).value(x), scaled(x, domain)
        paper = node_windows(x, y, options.order, domain, options.half_width, options.min_points).coefficients
        efficient = chebyshev_fit(x, y, options.order, domain, extra=0).coefficients
        found.append(Signals(x, y, evaluate(t, paper) - true, evaluate(t, efficient) - true, true))
    return found


def _decibels(ratios: list[float]) -> Measured | str:
    """Return the mean power in dB with its standard error; what is rounding, in words."""
    power = np.array(ratios) ** 2
    level = float(decibel(power.mean()))
    if level < SILENT:
        return "rounding"
    return Measured(level, float(10 / np.log(10) * power.std(ddof=1) / power.mean() / np.sqrt(len(power))))


def _draw(figure: Figure, cases: list[Signals]) -> None:
    """Draw both cases one above the other, as the paper does."""
    from whid.plots._style import MEASURED, MODEL, OTHER, QUIET

    figure.set_size_inches(7.4, 7.0)
    for axes, signals, (_, words) in zip(figure.subplots(2, 1, sharex=True), cases, CASES, strict=True):
        shown = ((signals.x, QUIET, "input"), (signals.y, MEASURED, "output"))
        errors = ((signals.paper, OTHER, "error, paper's method"), (signals.efficient, MODEL, "error, least squares"))
        silent = spectrum(signals.efficient)[1].max() < SILENT
        for x, colour, name in (*shown, *errors):
            frequency, density = spectrum(x)
            if density.max() > SILENT:
                axes.plot(frequency, density, color=colour, lw=1.0, label=name)
        axes.set_title(f"Figure 3, redrawn: {words}{EXACT if silent else ''}")
        axes.set_ylabel("power density, dB")
        axes.set_ylim(FLOOR, 38)
        axes.legend(loc="upper left", ncols=2)
    axes.set_xlabel("frequency over Nyquist")
    figure.tight_layout()
