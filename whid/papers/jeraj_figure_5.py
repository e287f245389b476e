"""[Jeraj and Mathews], Figure 5: the equaliser."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._jeraj import NOT_GIVEN, Trial, curve, decibel, method, spectrum, trials
from whid.papers._monte_carlo import held
from whid.quantity import Measured
from whid.record import Record
from whid.signal import Floats
from whid.stages._chebyshev import evaluate, scaled
from whid.stages.equaliser import Equaliser

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLEAN = -58.0  # bar B5, dB


@dataclass(frozen=True, kw_only=True)
class JerajFigure5(Exhibit):
    """Error of curve and equaliser in cascade, and its spectrum ([Jeraj and Mathews], Figures 4 and 5).

    paper's method  lines at the Chebyshev nodes of the output, the input fitted over the noisy output
    efficient       the inverse of the least-squares fit of the curve
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return the error's power over the input's, without and with the noise in the cascade, mean of the runs in dB."""
        found: dict[str, list[float]] = {}
        first: tuple[Trial, dict[str, Floats]] | None = None
        for trial in trials(bench, bench.runs, 20.0, 300):
            errors = cascade_errors(bench, trial)
            first = first or (trial, errors)
            for name, error in errors.items():
                found.setdefault(name, []).append(float(np.mean(error**2) / np.mean(trial.x**2)))
        level = {name: _decibels(powers) for name, powers in found.items()}
        rows = [
            Row(f"error over input, {words}, dB", None, level[f"paper {kind}"], level[f"efficient {kind}"])
            for kind, words in (("clean", "no noise in the cascade"), ("noisy", "noise of 20 dB in the cascade"))
        ]
        assert first is not None
        shown, order = first, method(bench)[0].inverse_order
        return Regenerated(
            f"Figure 5 of Jeraj and Mathews: equaliser of order {order} at 20 dB, inputs on [-1, 1], {bench.runs} runs",
            rows,
            (
                "The figure is lost: redrawn from our runs, nothing of it can be compared.",
                "Regressing the input on the noisy output flattens the curve by the noise in the regressor, however long "
                "the record: the inverse of the forward fit has no such bias.",
                "Both are clamped to the outputs that the domain covers: a polynomial of order 21 explodes beyond them.",
                "That the method does not depend on the input, as the paper says, is not so: the density of the input near "
                "a node is the variance there.",
                NOT_GIVEN,
            ),
            (held("B5 clean cascade of the inverse, dB", level["efficient clean"], below=CLEAN),),
            lambda figure: _draw(figure, *shown),
        )


def cascade_errors(bench: Bench, trial: Trial) -> dict[str, Floats]:
    """Return x̂ − x behind the equaliser: of the true curve's output on the domain, and of the noisy one."""
    options, domain = method(bench)
    record = Record(u=trial.x, y=trial.y, dt=1.0, intersample="discrete")
    stages: Any = replace(options, inverse=True)([record])
    stage: Equaliser = next(found for found in stages if isinstance(found, Equaliser))
    inside = (trial.x >= domain[0]) & (trial.x <= domain[1])
    x = trial.x[inside]
    clean = curve(bench).value(x)
    noisy = trial.y[inside]
    return {
        f"{name} {kind}": _undone(stage, coefficients, y) - x
        for name, coefficients in (("paper", stage.regressed), ("efficient", stage.coefficients))
        for kind, y in (("clean", clean), ("noisy", noisy))
    }


def _undone(stage: Equaliser, coefficients: Floats, y: Floats) -> Floats:
    return evaluate(np.clip(scaled(y, stage.domain), -1, 1), coefficients)


def _decibels(powers: list[float]) -> Measured:
    power = np.array(powers)
    spread = power.std(ddof=1) / np.sqrt(len(power)) if len(power) > 1 else np.nan
    return Measured(float(decibel(power.mean())), float(10 / np.log(10) * spread / power.mean()))


def _draw(figure: Figure, trial: Trial, errors: dict[str, Floats]) -> None:
    """Draw the spectra of one run."""
    from whid.plots._style import MEASURED, MODEL, OTHER, QUIET

    figure.set_size_inches(7.4, 4.8)
    axes = figure.subplots()
    lines = [(trial.x, QUIET, "-", "input"), (trial.y, MEASURED, "-", "noisy output")]
    for name, colour, words in (("paper", OTHER, "paper's method"), ("efficient", MODEL, "inverse of the fit")):
        lines += [(errors[f"{name} noisy"], colour, ":", f"error, noise in the cascade, {words}")]
        lines += [(errors[f"{name} clean"], colour, "-", f"error, no noise in it, {words}")]
    for x, colour, style, words in lines:
        axes.plot(*spectrum(x), color=colour, ls=style, lw=1.0, label=words)
    axes.set_xlabel("frequency over Nyquist")
    axes.set_ylabel("power density, dB")
    axes.set_title("Figure 5, redrawn: equaliser at 20 dB")
    axes.set_ylim(-120, 30)
    axes.legend(loc="upper left", ncols=2, fontsize=7.5)
    figure.tight_layout()
