"""[Giri], the simulation section that the paper left out: phases and gains over the signal-to-noise ratio."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from whid.disturbances.white import White
from whid.errors import WhidError
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.papers._giri import borders
from whid.papers._monte_carlo import finite, held, rmse, share
from whid.quantity import Measured
from whid.result import Check
from whid.score import linear_gain
from whid.signal import Floats
from whid.stages.static_or_backlash import SIGNIFICANCE
from whid.system import System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PHASE = "linear.phase@"
GAIN = "linear.gain@"
TOLD = "told"
LEFT_OUT = "The paper announces simulations and prints none: plant, noise and counts are our own."
CLAIMED = "The error that a gain ratio claims takes its two gains for independent: it is an upper limit."


@dataclass(frozen=True, kw_only=True)
class GiriSimulations(Exhibit):
    """RMSE of phases and gain ratios at each signal-to-noise ratio ([Giri], the section that is missing).

    Paper's method: separable least squares, one record at a time; efficient: whole periods linked through the contacts, all
    records at once. Gains are taken over that of the first frequency: their common scale is the normalisation's.

    plant         its name in the title
    phases_below  bars on the phases: pairs of a ratio in dB and rad
    """

    plant: str = ""
    snr_db: tuple[float, ...] = (20.0, 40.0, 60.0)
    phases_below: tuple[tuple[float, float], ...] = ()

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return a row for phases and one for gains at every ratio."""
        assert bench.plant is not None
        found = [_errors(bench, bench.plant, snr) for snr in self.snr_db]
        rows = [
            Row(f"RMSE of {what} at {snr:g} dB", None, one[f"paper.{kind}"], one[kind], one[f"claimed {kind}"])
            for snr, one in zip(self.snr_db, found, strict=True)
            for what, kind in (("phases, rad", PHASE), ("gain ratios", GAIN))
        ]
        kind = "static" if np.array_equal(*borders(bench)) else "backlash"
        rows += [
            Row(f"runs that are told to be {kind} at {snr:g} dB", None, None, one[TOLD], 1, tolerance=0.01)
            for snr, one in zip(self.snr_db, found, strict=True)
        ]
        below = dict(self.phases_below)
        bars: list[Check] = [
            held(f"D3 phases at {snr:g} dB", one[PHASE], below=below[snr])
            for snr, one in zip(self.snr_db, found, strict=True)
            if snr in below
        ]
        name = f" on plant {self.plant}" if self.plant else ""
        return Regenerated(
            f"Simulations that Giri et al. left out{name}: {bench.runs} runs at each of {len(self.snr_db)} ratios",
            rows, (LEFT_OUT, CLAIMED), tuple(bars),
            lambda figure: _draw(figure, f"Phases and gains over the noise{name}", self.snr_db, found),
            headings=("published", "paper's method, ours", "efficient, ours", "standard error it claims, or truth"),
        )  # fmt: skip


def _errors(bench: Bench, plant: System, snr: float) -> dict[str, Measured]:
    """Return the RMSE over runs and frequencies of both methods, and the root mean square of the errors they claim."""
    metrics = bench.metrics(plant=replace(plant, noise=(White(snr_db=snr),)))
    if not metrics:
        raise WhidError("table-failed", f"none of {bench.runs} runs at {snr:g} dB came to an end: {bench.failures[-1]}")
    omega = np.array(sorted(float(name.removeprefix(PHASE)) for name in metrics if name.startswith(PHASE)))
    g = linear_gain(plant, "front", omega)
    static = np.array_equal(*borders(bench))
    seen = finite(metrics["static.p"][:, 0])
    result = {TOLD: share(int(np.sum((seen >= SIGNIFICANCE) == static)), bench.runs)}
    for prefix in ("", "paper."):
        phase = _columns(metrics, f"{prefix}{PHASE}", omega)
        gain = _columns(metrics, f"{prefix}{GAIN}", omega)
        turned = np.angle(np.exp(1j * (phase[..., 0] - np.angle(g))))
        ratio = gain[..., 0] / gain[:, :1, 0] - np.abs(g) / np.abs(g[0])
        result[f"{prefix}{PHASE}"], result[f"{prefix}{GAIN}"] = rmse(turned), rmse(ratio[:, 1:])
        if not prefix:
            result[f"claimed {PHASE}"] = rmse(phase[..., 1])
            both = np.hypot(gain[:, 1:, 1] / gain[:, :1, 0], gain[:, 1:, 0] * gain[:, :1, 1] / gain[:, :1, 0] ** 2)
            result[f"claimed {GAIN}"] = rmse(both)
    return result


def _columns(metrics: Mapping[str, Floats], beginning: str, omega: Floats) -> Floats:
    """Return (runs, frequencies, 2): values and standard errors."""
    return np.stack([metrics[f"{beginning}{w:.6g}"] for w in omega], axis=1)


def _draw(figure: Figure, title: str, snr: tuple[float, ...], found: list[dict[str, Measured]]) -> None:
    """Draw both methods' RMSE over the ratio."""
    from whid.plots._style import MODEL, QUIET, TRUTH, spaced

    figure.set_size_inches(7.4, 5.4)
    for axes, (kind, what) in zip(
        figure.subplots(2, 1, sharex=True), ((PHASE, "phases, rad"), (GAIN, "gain ratios")), strict=True
    ):
        for key, colour, name in ((f"paper.{kind}", TRUTH, "paper's method"), (kind, MODEL, "efficient")):
            values, errors = (np.array([one[key][k] for one in found]) for k in (0, 1))
            axes.errorbar(snr, values, errors, fmt="o-", color=colour, capsize=2, label=name)
        axes.plot(snr, [one[f"claimed {kind}"].value for one in found], "--", color=QUIET, label="standard error it claims")
        axes.set_yscale("log")
        axes.set_ylabel(f"RMSE of {what}")
        axes.legend(loc="best")
    figure.axes[0].set_title(title)
    axes.set_xlabel("signal-to-noise ratio, dB")
    spaced(figure, 2, 1)
