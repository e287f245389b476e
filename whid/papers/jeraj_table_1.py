"""[Jeraj and Mathews], Table 1: mean and variance of the Chebyshev coefficients at 20 dB."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from whid.blocks.polynomial import Polynomial
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._jeraj import NOT_GIVEN, curve, method, trials
from whid.papers._monte_carlo import held, mean, variance
from whid.quantity import Measured
from whid.result import Check
from whid.signal import Floats
from whid.stages.chebyshev_fit import chebyshev_fit
from whid.stages.node_plus import node_plus
from whid.stages.node_windows import node_windows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SNR_DB, PRINTED_RUNS = 20.0, 50
REFERENCE = np.array([1.98, 5.68, 3.71, 3.63, 3.80, 4.31, 4.07, 2.02])  # 1e-6, independent trials: bar B1
BIAS = 4e-4  # bar B1, over 1000 runs


class Sample(NamedTuple):
    """Estimates of all runs, (runs, K + 1) each; against the bound in one number a run."""

    paper: Floats
    efficient: Floats
    plus: Floats
    bound: Floats  # variances
    chi2: Floats  # (runs,) of the efficient estimate


@dataclass(frozen=True, kw_only=True)
class JerajTable1(Exhibit):
    """Mean and variance of the Chebyshev coefficients over many runs ([Jeraj and Mathews], Table 1).

    paper's method  lines at the nodes
    efficient       global least squares
    bound           the true coefficient; of a variance the Cramér-Rao bound from the samples on the domain
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return a row a mean and a row a variance, with the printed ones."""
        options, domain = method(bench)
        like = Polynomial(coefficients=(0.0,) * (options.order + 1), basis="chebyshev", domain=domain)
        true = np.array(cast(Polynomial, curve(bench)).like(like).coefficients)
        found = _sample(bench, true)
        names = [f"C{j}" for j in range(len(true))]
        means = [
            Row(name, self.printed(name), mean(found.paper[:, j]), mean(found.efficient[:, j]), float(true[j]))
            for j, name in enumerate(names)
        ]
        variances = [
            Row(
                f"variance of {name}, 1e-6", self.printed(f"variance of {name}"), variance(1e3 * found.paper[:, j]),
                variance(1e3 * found.efficient[:, j]), float(1e6 * found.bound[:, j].mean()), None,
            )
            for j, name in enumerate(names)
        ]  # fmt: skip
        off = _deviations(self, names)
        return Regenerated(
            f"Table 1 of Jeraj and Mathews: Chebyshev coefficients at 20 dB, {bench.runs} runs (published: 50)",
            [*means, *variances],
            (
                NOT_GIVEN,
                f"The printed variances against ours (paper's method): chi-square of {len(off)} is {np.sum(off**2):.1f}, "
                "a draw of 50 runs.",
                "The paper's (7)-(8) are right; its (1) is a bound, and of the interpolant, not of the best approximation.",
                "Least squares uses the samples on [-1, 1]; the bound is that of those samples.",
            ),
            tuple(_bars(found, true, bench)),
            lambda figure: _draw(figure, variances),
            ("published", "paper's method, ours", "efficient, ours", "true, or bound"),
        )


def _sample(bench: Bench, true: Floats) -> Sample:
    options, domain = method(bench)
    paper, efficient, plus, bound, chi2 = [], [], [], [], []
    for x, y, std in trials(bench, bench.runs, SNR_DB, 1):
        fit = chebyshev_fit(x, y, options.order, domain)
        paper.append(node_windows(x, y, options.order, domain, options.half_width, options.min_points).coefficients)
        efficient.append(fit.coefficients)
        plus.append(node_plus(x, y, fit, options.min_points).coefficients)
        bound.append(std**2 * np.diag(fit.inverse_gram))
        error = fit.coefficients - true
        chi2.append(error @ np.linalg.solve(std**2 * fit.inverse_gram, error))
    return Sample(np.array(paper), np.array(efficient), np.array(plus), np.array(bound), np.array(chi2))


def _deviations(table: JerajTable1, names: list[str]) -> Floats:
    """Return how far the printed variances lie from the reference, in standard deviations of log s² of 50 runs."""
    printed = np.array([table.printed(f"variance of {name}") or np.nan for name in names], float)
    count = min(len(printed), len(REFERENCE))
    off = np.log(printed[:count] / REFERENCE[:count]) / np.sqrt(2 / (PRINTED_RUNS - 1))
    return np.asarray(off[np.isfinite(off)])


def _bars(found: Sample, true: Floats, bench: Bench) -> Iterator[Check]:
    runs = len(found.chi2)
    if len(true) == len(REFERENCE):
        fifty = found.paper[:PRINTED_RUNS]
        ratio = fifty.var(axis=0, ddof=1) / (1e-6 * REFERENCE)
        yield Check("B1 smallest variance of 50 runs over reference", float(ratio.min()), above=0.45)
        yield Check("B1 largest variance of 50 runs over reference", float(ratio.max()), below=1.75)
        allowed = 3.5 * fifty.std(axis=0, ddof=1) / np.sqrt(len(fifty)) + 2e-4
        off = np.abs(fifty.mean(axis=0) - true) / allowed
        yield Check("B1 largest |mean − true| over what is allowed", float(off.max()), below=1.0)
    if bench.full:
        bias = np.abs(found.paper.mean(axis=0) - true)
        worst = int(bias.argmax())
        sem = float(found.paper[:, worst].std(ddof=1) / np.sqrt(runs))
        yield held("B1 largest |bias|", Measured(float(bias[worst]), sem), below=BIAS)
    chi2 = mean(found.chi2)
    yield held(f"B3 mean χ² of {len(true)}, least squares", chi2, len(true) + 0.4, len(true) - 0.4)
    for name, estimate, low, high in (
        ("B3 least squares", found.efficient, 0.9, 1.1),
        ("B4 node-plus", found.plus, None, 1.3),
    ):
        square = np.sum((estimate - true) ** 2, axis=1) / found.bound.sum(axis=1).mean()
        yield held(f"{name}, trace over bound", mean(square), below=high, above=low)


def _draw(figure: Figure, rows: list[Row]) -> None:
    """Draw the variances, the printed ones among ours."""
    from whid.plots._style import MEASURED, MODEL, OTHER, TRUTH

    figure.set_size_inches(7.4, 4.4)
    axes = figure.subplots()
    place = np.arange(len(rows))
    half = 1.96 * np.sqrt(2 / (PRINTED_RUNS - 1))
    paper = np.array([cast(Measured, row.paper).value for row in rows])
    axes.fill_between(place, paper * (1 - half), paper * (1 + half), color=OTHER, alpha=0.15, lw=0, label="95 % of 50 runs")
    axes.plot(place, paper, "s-", color=OTHER, mfc="none", label="paper's method, ours")
    axes.plot(place, [cast(float, row.published) for row in rows], "x", color=TRUTH, ms=7, mew=1.6, label="published")
    axes.plot(place, [cast(Measured, row.efficient).value for row in rows], "o-", color=MODEL, label="least squares, ours")
    axes.plot(place, [cast(float, row.bound) for row in rows], "_", color=MEASURED, ms=12, label="Cramér-Rao bound")
    axes.set_yscale("log")
    axes.set_xticks(place, [f"$C_{j}$" for j in place])
    axes.set_ylabel("variance, 1e-6")
    axes.set_title("Table 1: variances of the Chebyshev coefficients at 20 dB")
    axes.legend(loc="lower left", ncols=2)
    figure.tight_layout()
