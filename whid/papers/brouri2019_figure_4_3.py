"""[Brouri2019], Figures 4.2, 4.3a, 4.3b: the control sequence, the output, the estimate of x, and a zoom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from whid.papers._brouri2019 import LOST, one_run, staircase
from whid.papers._exhibit import Bench, Exhibit, Regenerated, Row
from whid.predict import predict
from whid.quantity import Measured
from whid.record import Record
from whid.signal import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ZOOM = 9  # the hold that is shown large


@dataclass(frozen=True, kw_only=True)
class Brouri2019Figure43(Exhibit):
    """Control sequence, output, estimate of x, zoom ([Brouri2019], Figures 4.2, 4.3a and 4.3b).

    paper's method  the mean of each hold behind the settling time, (3.9) or (3.13), corrected
    """

    def regenerate(self, bench: Bench) -> Regenerated:
        """Return the sequence in numbers, and how far the estimates of x are from x."""
        assert bench.plant is not None
        run = one_run(bench)
        record, curve = run.records[0], run.stages["static_curve"]
        holds: list[Any] = list(record.select("hold"))
        levels = np.array([part.level for part in holds])
        settled = predict(bench.plant.tree, record)
        steady = np.array([bench.plant.tree.steady(float(u), record.dt)[0] for u in curve.level])
        off = (curve.mean - steady) / curve.mean_std
        rest = [settled[part.stop - 1] - bench.plant.tree.steady(float(part.level), record.dt)[0] for part in holds]
        per_level = Measured(float(off @ off) / len(off), float(np.sqrt(2 / len(off))))
        rows = [
            Row("levels of the control sequence", None, len(np.unique(levels))),
            Row("lowest level", None, float(levels.min())),
            Row("highest level", None, float(levels.max())),
            Row("hold, s", None, float((holds[0].stop - holds[0].start) * record.dt)),
            Row("settling time taken, s", None, float(curve.settle), tolerance=float(0.2 * curve.settle)),
            Row("noise, std", None, _spread(curve.noise_std, int(curve.samples.sum())), None, 0.5),
            Row("chi-square of the estimates of x, a level", None, per_level, None, 1),
            Row("x minus its limit at the end of a hold, largest", None, float(np.abs(rest).max()), tolerance=1e-3),
        ]
        return Regenerated(
            "Figures 4.2 and 4.3 of Brouri, Rabyi and Ouannou (2019): control sequence, output and estimate of x",
            rows,
            (
                LOST,
                "(3.9) and (3.13) as printed have one sample too many and lack the sample time: corrected here.",
                "The paper gives neither the levels nor how long they are held: 16 levels of 200 s are ours.",
            ),
            draw=lambda figure: _draw(figure, record, curve),
            headings=("published", "paper's method, ours", "efficient, ours", "true"),
        )


def _spread(std: float, samples: int) -> Measured:
    return Measured(float(std), float(std / np.sqrt(2 * samples)))


def _draw(figure: Figure, record: Record, curve: Any) -> None:
    """Draw input, output with x̂, and one hold large."""
    from whid.plots._style import MEASURED, MODEL, QUIET, envelope

    figure.set_size_inches(7.4, 7.6)
    first, second, third = figure.subplots(3, 1)
    shown = staircase(record)
    t, u, y = record.time[shown], record.u[shown], record.y[shown]
    first.plot(t, u, color=MEASURED, lw=1.2)
    first.set_title("Figure 4.2, redrawn: control sequence")
    first.set_ylabel("u")
    second.plot(*envelope(t, y), color=QUIET, lw=0.8, label="y")
    for part, mean in zip(record.select("hold"), curve.mean, strict=True):
        _level(second, record, part, curve.settle, mean, MODEL)
    second.set_title("Figure 4.3a, redrawn: output and estimate of x")
    second.set_ylabel("y, estimate of x")
    hold = list(record.select("hold"))[ZOOM]
    inside = slice(hold.start, hold.stop)
    third.plot(record.time[inside], record.y[inside], color=QUIET, lw=0.8, label="y")
    _level(third, record, hold, curve.settle, curve.mean[ZOOM], MODEL, "estimate of x, behind the settling time")
    third.set_title("Figure 4.3b, redrawn: one level")
    third.set_ylabel("y, estimate of x")
    third.set_xlabel("time, s")
    middle: Floats = record.y[inside][len(record.y[inside]) // 2 :]
    third.set_ylim(middle.mean() - 12 * middle.std(), middle.mean() + 12 * middle.std())
    third.legend(loc="upper right")
    figure.tight_layout()


def _level(axes: Any, record: Record, part: Any, settle: float, mean: float, colour: str, label: str | None = None) -> None:
    times = record.time[part.start] + settle, record.time[part.stop - 1]
    axes.plot(times, [mean, mean], color=colour, lw=2.0, label=label)
