"""All sines through one backlash: borders, a gain and a phase a frequency, on one branch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.fit import Estimate, Parameter
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._hysteresis import Lumped, Swing, dual, other_branch, steady_loop
from whid.stages._loop_fit import LoopFit, free_gains
from whid.stages.identifiability import distinct, nearest

RIVAL = 10.8  # χ² by which the other branch must be worse
RATIOS = np.geomspace(0.05, 20.0, 121)  # of a sine's amplitude at the backlash to the reference's


class JointLoops(NamedTuple):
    """Joint loops: borders and frequency response in the scale of eq. (29), Σ|rising_i|^{n/i} = 1 over i ≥ 1.

    margin: χ² by which the sines of a frequency would be worse on the other branch, −G(jω) there alone.
    """

    omega: Annotated[Floats, Quantity("rad/s", ("omega",))]
    gain: Annotated[Floats, Quantity("1/input", ("omega",), error="gain_std")]
    gain_std: Annotated[Floats, Quantity("1/input", ("omega",))]
    phase: Annotated[Floats, Quantity("rad", ("omega",), error="phase_std")]
    phase_std: Annotated[Floats, Quantity("rad", ("omega",))]
    covariance: Annotated[Floats, Quantity("1", ("number", "number"))]  # of log gains, then phases
    rising: Annotated[Floats, Quantity("output", ("power",), error="rising_std")]
    rising_std: Annotated[Floats, Quantity("output", ("power",))]
    falling: Annotated[Floats, Quantity("output", ("power",), error="falling_std")]
    falling_std: Annotated[Floats, Quantity("output", ("power",))]
    margin: Annotated[Floats, Quantity("1", ("omega",))]
    kind: tuple[str, ...]  # of every sine's loop
    static: bool
    reference: int  # of the frequencies: its log gain is held in `estimate`
    scale: float  # of x in `estimate`, one unit here
    estimate: Estimate

    @property
    def resolved(self) -> bool:
        """Tell whether all frequencies are surely on one branch."""
        return bool(self.margin.min(initial=np.inf) > RIVAL)

    def table(self) -> Table:
        """Return the frequency response and the borders."""
        rows = [
            (f"G({w:.6g})", Measured(float(g), float(gs)), Measured(float(p), float(ps)))
            for w, g, gs, p, ps in zip(self.omega, self.gain, self.gain_std, self.phase, self.phase_std, strict=True)
        ]
        rows += [
            (f"power {k}", Measured(float(self.rising[k]), float(self.rising_std[k])),
             Measured(float(self.falling[k]), float(self.falling_std[k])))
            for k in range(len(self.rising))
        ]  # fmt: skip
        e = self.estimate
        notes = [f"χ²/dof {e.chi2:.1f}/{e.dof}; scaled so that Σ|rising_i|^(n/i) = 1 over i ≥ 1, sign so that G(0) > 0"]
        notes += [] if self.resolved else ["the branch of some frequency is open: phase or phase + π"]
        title = "Joint static curve" if self.static else "Joint backlash"
        return Table(title, ("", "gain; rising border", "phase, rad; falling border"), tuple(rows), tuple(notes))

    def metrics(self) -> dict[str, Measured]:
        """Return `linear.gain@ω`, `linear.phase@ω`, `rising.k`, `falling.k`."""
        return named(self)


def named(found: object) -> dict[str, Measured]:
    """Return gains, phases and border coefficients by name."""
    made = {}
    for what in ("gain", "phase"):
        values, errors = getattr(found, what), getattr(found, f"{what}_std")
        for w, v, s in zip(found.omega, values, errors, strict=True):  # type: ignore[attr-defined]
            made[f"linear.{what}@{w:.6g}"] = Measured(float(v), float(s))
    for side in ("rising", "falling"):
        for k, (v, s) in enumerate(zip(getattr(found, side), getattr(found, f"{side}_std"), strict=True)):
            made[f"{side}.{k}"] = Measured(float(v), float(s))
    return made


def joint_loops(swings: Sequence[Swing], ones: Sequence[Lumped], degree: int, *, static: bool = False) -> JointLoops:
    """Fit all sines at once: min Σ_sines Σ_m ((w − mean_m)/std_m)² over borders, log|G(jω)| and arg G(jω).

    ones: what each sine alone gave. The one that moves the output most is the reference, it anchors the scale; the others
    start from its borders, on the branch and at the amplitude where these explain them best. The branch of all is that of
    G(0) > 0: the phase nearest 0 at the lowest frequency (the data cannot tell G, F[x] from −G, F[−x]).
    Source [Giri], eqs. (12), (29)-(34), the d_i too divided by the sum of the α; [PAPERS D].
    """
    omega = distinct(np.array([s.omega for s in swings]))
    index = nearest(omega, np.array([s.omega for s in swings]))
    anchor = int(np.argmax([np.ptp(s.mean) for s in swings]))
    reference = int(index[anchor])
    unit = swings[anchor].amplitude ** -np.arange(degree + 1.0)
    rising, falling = ones[anchor].rising * unit, ones[anchor].falling * unit
    placed = [_placed(s, one, rising, falling, degree, static) for s, one in zip(swings, ones, strict=True)]
    log_gain, phase = _started(swings, placed, index, len(omega), reference)
    fit = LoopFit(swings, degree, free_gains(index, len(omega), reference), static)
    names = [Parameter(f"log_gain({w:.6g})", log_gain[j]) for j, w in enumerate(omega) if j != reference]
    names += [Parameter(f"phase({w:.6g})", phase[j], "rad") for j, w in enumerate(omega)]
    found = fit.solve(rising, falling, names)
    margin = np.array([_margin(fit, found, index, j, len(omega)) for j in range(len(omega))])
    return _result(swings, omega, index, reference, found, fit, margin)


class _Place(NamedTuple):
    """Where the reference's borders explain a sine best."""

    log_gain: float
    phase: float
    chi2: float


def _placed(swing: Swing, one: Lumped, rising: Floats, falling: Floats, degree: int, static: bool) -> _Place:
    """Return the gain (that of the reference is 1) and phase of a sine, the better of both branches."""
    fit = LoopFit([swing], degree, free_gains(np.zeros(1, int), 1, 1), static)
    borders = rising if static else np.append(rising, falling)
    power, found = np.arange(degree + 1), []
    for candidate in (one, other_branch(one)):
        lumps = np.concatenate([candidate.rising, candidate.falling])
        cost = [_apart(lumps, rising, falling, swing.amplitude * ratio, power) for ratio in RATIOS]
        near = RATIOS[np.argsort(cost)[:3]]
        tried = [np.concatenate([borders, [np.log(r), candidate.phase]]) for r in near]
        chi2 = [float(_with_gain(fit, x, degree, static)) for x in tried]
        best = int(np.argmin(chi2))
        found.append(_Place(float(np.log(near[best])), candidate.phase, chi2[best]))
    return min(found, key=lambda place: place.chi2)


def _apart(lumps: Floats, rising: Floats, falling: Floats, size: float, power: NDArray[np.intp]) -> float:
    """Return how far borders scaled to an amplitude are from lumped ones, over z ∈ [−1, 1]."""
    z = np.linspace(-1, 1, 21)
    design = z[:, None] ** power
    a, b = np.split(lumps, 2)
    scale = size**power
    return float(np.sum((design @ (a - rising * scale)) ** 2) + np.sum((design @ (b - falling * scale)) ** 2))


def _with_gain(fit: LoopFit, x: Floats, degree: int, static: bool) -> float:
    own = (degree + 1) * (1 if static else 2)
    swing = fit.swings[0]
    scaled = swing._replace(drive=swing.drive * np.exp(x[own]))
    return float(fit._replace(swings=[scaled]).chi2(np.append(x[:own], x[own + 1]))[0])


def _started(
    swings: Sequence[Swing], placed: Sequence[_Place], index: NDArray[np.intp], count: int, reference: int
) -> tuple[list[float], list[float]]:
    """Return a start for every frequency: of its sine that moves the output most."""
    best = [max(np.flatnonzero(index == j).tolist(), key=lambda k: np.ptp(swings[k].mean)) for j in range(count)]
    zero = placed[best[reference]].log_gain
    return [placed[k].log_gain - zero for k in best], [placed[k].phase for k in best]


def _margin(fit: LoopFit, found: Estimate, index: NDArray[np.intp], j: int, count: int) -> float:
    """Return by how much χ² of a frequency's sines rises with −G there, phase and gain fitted again."""
    own = len(found.values) - (2 * count - 1)
    rising, falling = fit.borders(found.values)
    sines = [s for s, i in zip(fit.swings, index, strict=True) if i == j]
    shifts = _log_gains(found, own, count, fit)
    phase = found.values[own + count - 1 + j]
    single = LoopFit(sines, fit.degree, free_gains(np.zeros(len(sines), int), 1, 1), fit.static)
    borders = rising if fit.static else np.append(rising, falling)
    here = float(single._replace(swings=_grown(sines, shifts[j])).chi2(np.append(borders, phase)).sum())
    other = np.inf
    for shift in shifts[j] + np.linspace(-0.6, 0.6, 7):
        for turn in np.linspace(-0.6, 0.6, 9):
            trial = np.append(borders, phase + np.pi + turn)
            other = min(other, float(single._replace(swings=_grown(sines, shift)).chi2(trial).sum()))
    return other - here


def _grown(sines: Sequence[Swing], log_gain: float) -> list[Swing]:
    return [s._replace(drive=s.drive * np.exp(log_gain)) for s in sines]


def _log_gains(found: Estimate, own: int, count: int, fit: LoopFit) -> Floats:
    """Return the log gain of every frequency, the reference's 0 put in."""
    gains = fit.linear(found.values[own:])
    index = np.array([np.flatnonzero(row)[0] for row in gains.by_phase]) - (count - 1)
    whole = np.zeros(count)
    whole[index] = gains.log_gain
    return whole


def _result(
    swings: Sequence[Swing], omega: Floats, index: NDArray[np.intp], reference: int, found: Estimate, fit: LoopFit,
    margin: Floats,
) -> JointLoops:  # fmt: skip
    count, n = len(omega), fit.degree + 1
    own = n if fit.static else 2 * n
    flip = bool(np.cos(found.values[own + count - 1]) < 0)  # of the lowest frequency

    def printed(theta: Floats) -> Floats:
        """Return log gains, phases, borders in the paper's scale and on the branch of G(0) > 0."""
        rising, falling = dual(*fit.borders(theta)) if flip else fit.borders(theta)
        k = paper_scale(rising, falling)
        shape = k ** np.arange(n)
        gains = np.insert(theta[own : own + count - 1], reference, 0.0) - np.log(k)
        phase = theta[own + count - 1 :] + (np.pi if flip else 0.0)
        return np.concatenate([gains, phase, rising * shape, falling * shape])

    values = printed(found.values)
    steps = np.maximum(1e-6 * np.abs(found.values), 1e-9)
    change = np.array([(printed(found.values + d) - printed(found.values - d)) / (2 * s)
                       for s, d in zip(steps, np.diag(steps), strict=True)]).T  # fmt: skip
    covariance = change @ found.covariance @ change.T
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    log_gain, phase, rising, falling = np.split(values, [count, 2 * count, 2 * count + n])
    _, phase_std, rising_std, falling_std = np.split(std, [count, 2 * count, 2 * count + n])
    raw_rising, raw_falling = fit.borders(found.values)
    kinds, shifts = [], np.insert(found.values[own : own + count - 1], reference, 0.0)
    for k, swing in enumerate(swings):
        size = (swing.amplitude * np.exp(shifts[index[k]])) ** np.arange(n)
        kinds.append("static" if fit.static else steady_loop(raw_rising * size, raw_falling * size, swing.touch).kind)
    gain = np.exp(log_gain)
    return JointLoops(
        omega, gain, gain * std[:count], wrapped(phase), phase_std, covariance[: 2 * count, : 2 * count],
        rising, rising_std, falling, falling_std, margin, tuple(kinds), fit.static, reference,
        float(paper_scale(*(dual(raw_rising, raw_falling) if flip else (raw_rising, raw_falling)))), found,
    )  # fmt: skip


def paper_scale(rising: Floats, falling: Floats) -> float:
    """Return K of eq. (29), (Σ|a_i|^{n/i})^{−1/n} over i ≥ 1; over both borders where the rising one is constant."""
    n, i = len(rising) - 1, np.arange(1, len(rising))
    total = np.sum(np.abs(rising[1:]) ** (n / i)) or np.sum(np.abs(falling[1:]) ** (n / i))
    return float(total ** (-1 / n)) if total else 1.0


def wrapped(phase: Floats) -> Floats:
    """Return phases in (−π, π]."""
    return np.asarray(np.pi - np.mod(np.pi - phase, 2 * np.pi))
