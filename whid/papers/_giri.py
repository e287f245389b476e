"""What the exhibits of [Giri] share: one averaged period on a plant, its loop by theory and by fit, and how it is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from whid.blocks.backlash import Backlash
from whid.blocks.polynomial import Polynomial
from whid.methods._loops import gather
from whid.papers._exhibit import Bench
from whid.score import linear_response
from whid.signal import Floats
from whid.simulate import simulate
from whid.stages._hysteresis import Loop, Swing, dual, response, steady_loop
from whid.stages.joint_loops import wrapped
from whid.stages.periods import Harmonics

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOST = "The figure is lost: redrawn from our own plant, nothing of it can be compared."
BRANCH = "Estimates are on the truth's branch: the data cannot tell G, F[x] from −G, F[−x]."


class Numbers(NamedTuple):
    """A sine behind G and the borders in powers of its cosine, ([Giri], eq. (12)), as one vector for `carried`."""

    phase: float
    rising: Floats
    falling: Floats

    @classmethod
    def of(cls, x: Floats) -> Numbers:
        """Return them from (phase, rising, falling)."""
        return cls(float(x[0]), *np.split(np.asarray(x[1:], float), 2))

    def near(self, phase: float) -> Numbers:
        """Return them on the branch whose phase is nearer to a given one, and the phase within π of that."""
        away = wrapped(np.array([self.phase - phase]))[0]
        if abs(away) <= np.pi / 2:
            return self._replace(phase=float(phase + away))
        return Numbers(float(phase + wrapped(np.array([away - np.pi]))[0]), *dual(self.rising, self.falling))

    @property
    def loop(self) -> Loop:
        """Return the steady loop."""
        return steady_loop(self.rising, self.falling)


class Seen(NamedTuple):
    """One sine experiment of the study: what was averaged, and what is true of it."""

    swing: Swing
    harmonics: Harmonics
    truth: Numbers
    size: float  # U|G(jω)|
    dt: float


def seen(bench: Bench, number: int, key: int) -> Seen:
    """Return the first sine of an experiment of the study, with noise drawn for a key."""
    assert bench.plant is not None
    experiment = bench.experiments[number]
    record = simulate(bench.plant, experiment, bench.rng(key, number))
    one = gather([record]).sines[0]
    g = complex(linear_response(bench.plant, np.array([one.swing.omega]))[0])
    size = one.swing.amplitude * abs(g)
    scale = size ** np.arange(len(borders(bench)[0]))
    rising, falling = (side * scale for side in borders(bench))
    return Seen(one.swing, one.harmonics, Numbers(float(np.angle(g)), rising, falling), size, experiment.dt)


def borders(bench: Bench) -> tuple[Floats, Floats]:
    """Return the coefficients of the plant's borders, rising and falling; those of a curve are the same."""
    assert bench.plant is not None
    last = bench.plant.chain[-1]
    if isinstance(last, Polynomial):
        return np.array(last.coefficients, float), np.array(last.coefficients, float)
    falling, rising = cast(Backlash, last).table
    return rising, falling


def stages_of(numbers: Numbers) -> Floats:
    """Return how long the output holds after each turn, rad of the sine: (ω τ_d at the top, ω τ_a at the bottom).

    >>> stages_of(Numbers(0.0, np.array([-0.2, 1.0]), np.array([0.2, 1.0]))).round(4)
    array([0.9273, 0.9273])
    """
    loop = numbers.loop
    return np.array([np.arccos(np.clip(loop.down, -1, 1)), np.pi - np.arccos(np.clip(loop.up, -1, 1))])


def draw_sine(figure: Figure, one: Seen, fit: Numbers, title: str) -> None:
    """Draw the limit cycle above, input of the nonlinearity and output over two periods below, as the paper does."""
    from whid.plots._style import GAP, MEASURED, MODEL, QUIET, TRUTH

    figure.set_size_inches(7.4, 6.6)
    top, below = figure.subplots(2, 1, height_ratios=(1.15, 1))
    m, turn = len(one.swing.mean), 2 * np.pi * np.arange(721) / 720
    x = one.size * np.cos(one.swing.angle + one.truth.phase)
    for label, numbers, colour, style in (
        ("borders, estimated", fit, MODEL, "-"),
        ("borders, true", one.truth, TRUTH, "--"),
    ):
        z = np.linspace(-1.12, 1.12, 200)
        for side, name in ((numbers.rising, label), (numbers.falling, None)):
            top.plot(one.size * z, np.polynomial.polynomial.polyval(z, side), style, color=colour, lw=1.0, label=name)
    w = response(fit.rising, fit.falling, turn)[0]
    top.plot(x, one.swing.mean, ".", color=MEASURED, ms=2.5, label=f"output, mean of {one.swing.periods} periods")
    top.plot(one.size * np.cos(turn), w, color=MODEL, lw=2.2, alpha=0.5, label="limit cycle, estimated")
    for k in (130, 490):  # an arrow on either way
        arrow(top, one.size * np.cos(turn), w, k, MODEL)
    top.set_xlabel("x, input of the nonlinearity")
    top.set_ylabel("output")
    top.set_title(title)
    top.legend(loc="upper left", fontsize=8)
    t = np.arange(2 * m) * one.dt
    angle = np.tile(one.swing.angle, 2) + np.repeat([0, 2 * np.pi], m) + fit.phase
    below.plot(t, one.size * np.cos(angle), color=QUIET, lw=0.9, label="x, input of the nonlinearity")
    below.plot(t, np.tile(one.swing.mean, 2), ".", color=MEASURED, ms=2.0, label="output, mean of periods")
    below.plot(t, response(fit.rising, fit.falling, angle)[0], color=MODEL, label="output, estimated")
    names = {"falls from": 0.0, "rises from": np.pi}
    for (_, first), length in zip(names.items(), stages_of(fit), strict=True):
        starts = (first + 2 * np.pi * np.arange(-1, 4) - angle[0]) / one.swing.omega
        for start in starts:
            low, high = max(start, 0.0), min(start + length / one.swing.omega, t[-1])
            if high > low and length > 0.02:
                below.axvspan(low, high, color=GAP, alpha=0.4, lw=0)
            if 0 <= start <= t[-1]:
                below.axvline(start, color=QUIET, lw=0.6, ls=":")
            if 0 <= start <= 0.92 * t[-1]:
                below.annotate(
                    "$t_k$" if first == 0 else "$t_k+π/ω$", (start, 1), xycoords=("data", "axes fraction"),
                    xytext=(2, -9), textcoords="offset points", fontsize=8, color="#444444",
                )  # fmt: skip
    below.set_xlabel("time from the start of the period, s")
    below.set_ylabel("x, output")
    below.set_xlim(0, t[-1])
    below.margins(y=0.22)
    below.legend(loc="lower left", ncols=3, fontsize=8)
    figure.tight_layout()


def arrow(axes: Axes, x: Floats, y: Floats, k: int, colour: str) -> None:
    """Draw the head of an arrow along a line."""
    axes.annotate("", (x[k + 6], y[k + 6]), (x[k], y[k]), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 0.9})
