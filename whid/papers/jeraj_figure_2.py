"""[Jeraj and Mathews], Figure 2: the largest error over the signal-to-noise ratio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._jeraj import NOT_GIVEN, Ruler, disturbed, method, trials
from whid.papers._monte_carlo import mean
from whid.quantity import Measured
from whid.result import Check
from whid.signal import Floats
from whid.stages.chebyshev_fit import chebyshev_fit
from whid.stages.node_windows import each_node_windows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SNR_DB = (*np.arange(0.0, 55.0, 5.0).tolist(), float("inf"))
REFERENCE = {0: 8.95e-2, 10: 2.83e-2, 20: 8.96e-3, 30: 2.87e-3, 40: 1.0e-3, 50: 5.4e-4, np.inf: 4.7e-4}  # bar B2
WITHIN = 1.2, 0.8
ROUNDING = 1e-13  # bar B3: least squares without noise


@dataclass(frozen=True, kw_only=True)
class JerajFigure2(Exhibit):
    """Mean, maximum and variance of the largest error on [−1, 1], 0 … 50 dB and no noise ([Jeraj and Mathews], Figure 2)."""

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return three rows a signal-to-noise ratio; the original's numbers are in its picture only, which is lost."""
        paper, efficient = largest_errors(bench)
        rows = [row for snr, p, e in zip(SNR_DB, paper, efficient, strict=True) for row in _rows(snr, p, e)]
        bars = [
            Check(f"B2 mean largest error, {_words(snr)}, over reference", float(p.mean()) / REFERENCE[snr], *WITHIN)
            for snr, p in zip(SNR_DB, paper, strict=True)
            if snr in REFERENCE
        ]
        bars.append(Check("B3 largest error of least squares, no noise", float(efficient[-1].max()), below=ROUNDING))
        return Regenerated(
            f"Figure 2 of Jeraj and Mathews: largest error on [-1, 1], {bench.runs} runs at each of {len(SNR_DB)} ratios",
            rows,
            (
                "The figure is lost: redrawn from our runs, nothing of it can be compared.",
                "The paper says that the largest error falls exponentially with the ratio: it does to about 40 dB; then the "
                "curvature inside the windows is left, which no averaging removes.",
                "Least squares without noise leaves only rounding (below 1e-13): the order suffices.",
                NOT_GIVEN,
            ),
            tuple(bars),
            lambda figure: _draw(figure, paper, efficient),
        )


def largest_errors(bench: Bench, efficient: bool = True) -> tuple[Floats, Floats]:
    """Return the largest error of every run (ratios, runs), of the paper's method and least squares (NaN: not asked).

    Input and undisturbed output of a run are the same at every ratio, the noise is not.
    """
    options, domain = method(bench)
    ruler = Ruler.of(bench, options.order, domain)
    found = np.full((2, len(SNR_DB), bench.runs, options.order + 1), np.nan)
    for run, (x, clean, _) in enumerate(trials(bench, bench.runs, float("inf"), 100)):
        outputs = [disturbed(clean, snr, bench.rng(101 + k, run)) for k, snr in enumerate(SNR_DB)]
        lines = each_node_windows(x, outputs, options.order, domain, options.half_width, options.min_points)
        found[0, :, run] = [windows.coefficients for windows in lines]
        if efficient:
            fits = [chebyshev_fit(x, y, options.order, domain, extra=0) for y in outputs]
            found[1, :, run] = [fit.coefficients for fit in fits]
    return ruler.largest(found[0]), ruler.largest(found[1])


def _words(snr: float) -> str:
    return "no noise" if np.isinf(snr) else f"{snr:g} dB"


def _rows(snr: float, paper: Floats, efficient: Floats) -> list[Row]:
    """Return mean, maximum, variance; of least squares without noise nothing, it is rounding."""
    at, exact = _words(snr), np.isinf(snr)
    return [
        Row(f"mean, {at}", None, mean(paper), "rounding" if exact else mean(efficient)),
        Row(f"maximum, {at}", None, _maximum(paper), "rounding" if exact else _maximum(efficient)),
        Row(f"variance, {at}", None, _variance(paper), "rounding" if exact else _variance(efficient)),
    ]


def _maximum(errors: Floats) -> Measured:
    """Return the largest of all runs, and half the distance to the next ones as its error."""
    ordered = np.sort(errors)
    return Measured(float(ordered[-1]), float(ordered[-1] - np.quantile(ordered, 1 - 2 / len(ordered))))


def _variance(errors: Floats) -> Measured:
    """Return the variance with a standard error from the fourth moment: largest errors are not Gaussian."""
    centred = (errors - errors.mean()) ** 2
    size, runs = float(errors.var(ddof=1)), len(errors)
    return Measured(size, float(np.sqrt(max(np.mean(centred**2) - size**2, 0.0) / runs)))


def _draw(figure: Figure, paper: Floats, efficient: Floats) -> None:
    """Draw maximum, mean and variance as the paper does, ours dashed."""
    from whid.plots._style import MODEL, OTHER

    figure.set_size_inches(7.4, 5.0)
    axes = figure.subplots()
    place = np.append(np.array(SNR_DB[:-1]), 55.0)
    for errors, colour, style, words in (
        (paper, OTHER, "-", "paper's method"),
        (efficient[:-1], MODEL, "--", "least squares"),
    ):
        x = place[: len(errors)]
        axes.semilogy(x, errors.max(axis=1), "o", ls=style, color=colour, ms=4, label=f"maximum, {words}")
        axes.semilogy(x, errors.mean(axis=1), "x", ls=style, color=colour, ms=5, label=f"mean, {words}")
        axes.semilogy(
            x, errors.var(axis=1, ddof=1), "o", ls=style, color=colour, mfc="white", ms=5, label=f"variance, {words}"
        )
    axes.set_xticks(np.append(np.arange(0, 60, 10), 55), [*(str(v) for v in range(0, 60, 10)), "∞"])
    axes.set_xlabel("signal-to-noise ratio, dB")
    axes.set_ylabel("largest error on [−1, 1]; its variance")
    axes.set_title(f"Figure 2, redrawn: largest error over {paper.shape[1]} experiments")
    axes.legend(loc="lower left", ncols=2)
    figure.tight_layout()
