"""One sine through a backlash, efficiently: the whole period fitted, the constant stages linked to the borders."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from whid.fit import Estimate, Parameter, least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._hysteresis import TOUCH, lumped, remembered, response, steady_loop

MOST = 256  # angles of a period that the scan looks at
STAGES = 12  # lengths of a constant stage that the scan tries
TRIED, STARTS, EACH = 60, 6, 3  # of the scan: evaluated, descended from, and how many at most of one phase
SAME = 0.01  # χ²: two descents have ended in one minimum


class LinkedLoop(NamedTuple):
    """Linked loop: phase and borders of one sine, w = f(cos(ωt + arg drive + phase)), f in output units per amplitude.

    rising, falling are the lumped a_i(U|G|)ⁱ, d_i(U|G|)ⁱ of eq. (12c). The phase is known modulo π with the borders swapped
    and mirrored (eq. (6)): which of the two is decided for all sines together.
    """

    omega: Annotated[float, Quantity("rad/s")]
    amplitude: Annotated[float, Quantity("input")]
    phase: Annotated[float, Quantity("rad", error="phase_std")]
    phase_std: Annotated[float, Quantity("rad")]
    rising: Annotated[Floats, Quantity("output", ("power",), error="rising_std")]
    rising_std: Annotated[Floats, Quantity("output", ("power",))]
    falling: Annotated[Floats, Quantity("output", ("power",), error="falling_std")]
    falling_std: Annotated[Floats, Quantity("output", ("power",))]
    kind: str  # of the loop: full, one-sided, constant
    starts: int
    agreeing: int
    estimate: Estimate

    def table(self) -> Table:
        """Return the borders, a row a power."""
        columns = ("power", "rising, lumped", "falling, lumped")
        rows = tuple(
            (k, Measured(float(self.rising[k]), float(self.rising_std[k])),
             Measured(float(self.falling[k]), float(self.falling_std[k])))
            for k in range(len(self.rising))
        )  # fmt: skip
        e = self.estimate
        notes = (
            f"ω = {self.omega:.6g} rad/s, amplitude {self.amplitude:.6g}: phase "
            f"{self.phase:.5f} ± {self.phase_std:.2g} rad (modulo π), {self.kind} loop",
            f"χ²/dof {e.chi2:.1f}/{e.dof}; {self.agreeing} of {self.starts} starts agree",
        )
        return Table("One sine, linked", columns, rows, notes)


def linked_loop(
    mean: Floats, std: Floats, degree: int, omega: float = 1.0, amplitude: float = 1.0, drive: complex = 1.0
) -> LinkedLoop:
    """Fit phase and borders to one averaged period, all of it: min Σ ((w(θ_m + phase) − mean_m)/std_m)².

    w(θ): held after each turn of cos θ until the other border is met; what is held is the border's value at the turn, when
    the stage ends follows from the borders. A scan over phase and both stages, linear in the borders, gives the starts; the
    best are descended from. mean, std (M,) over one period from the part's start; drive: phasor of the input sine.
    Attains the Cramér-Rao bound, where (23a), the start of a stage, is biased. Source [Giri], eqs. (5), (12); [PAPERS D].

    >>> theta = 2 * np.pi * np.arange(64) / 64
    >>> w, *_ = response(np.array([-0.15, 1.0]), np.array([0.15, 1.0]), theta - 0.4)
    >>> found = linked_loop(w, np.full(64, 0.01), degree=1)
    >>> round(found.phase, 6), found.rising.round(6)
    (-0.4, array([-0.15,  1.  ]))
    """
    theta = 2 * np.pi * np.arange(len(mean)) / len(mean) + np.angle(drive)
    ends = [_descended(mean, std, theta, start) for start in _starts(mean, theta, degree, TOUCH * float(std.mean()))]
    best = min(ends, key=lambda e: e.chi2)
    found = lumped(best, omega, amplitude)
    kind = steady_loop(found.rising, found.falling, TOUCH * float(std.mean())).kind
    agreeing = sum(e.chi2 < best.chi2 + SAME for e in ends)
    return LinkedLoop(*found, kind=kind, starts=len(ends), agreeing=agreeing, estimate=best)


def _descended(mean: Floats, std: Floats, theta: Floats, start: Floats) -> Estimate:
    n, touch = (len(start) - 1) // 2, TOUCH * float(std.mean())

    @remembered
    def both(x: Floats) -> tuple[Floats, Floats]:
        w, by_angle, by_border = response(x[1 : n + 1], x[n + 1 :], theta + x[0], touch)
        return w - mean, np.column_stack([by_angle, by_border])

    names = ["phase", *(f"{side}.{k}" for side in ("rising", "falling") for k in range(n))]
    free = [Parameter(name, float(v)) for name, v in zip(names, start, strict=True)]
    return least_squares(lambda x: both(x)[0], lambda x: both(x)[1], free, 1 / std, max_iterations=60, tolerance=1e-4)


def _starts(mean: Floats, theta: Floats, degree: int, touch: float) -> Iterator[Floats]:
    """Yield (phase, rising, falling) by the scan, the best fit of the loop itself first."""
    step = max(1, len(mean) // MOST)
    y, first = mean[::step], float(theta[0])
    scanned = _scanned(y, degree)
    rated = []
    angle = 2 * np.pi * np.arange(len(y)) / len(y)
    for phase, rising, falling in scanned:
        w, *_ = response(rising, falling, angle + phase, touch)
        rated.append((float(np.sum((w - y) ** 2)), phase, rising, falling))
    rated.sort(key=lambda each: each[0])
    for _, phase, rising, falling in rated[:STARTS]:
        yield np.concatenate([[phase - first], rising, falling])


def _scanned(y: Floats, degree: int) -> Iterator[tuple[float, Floats, Floats]]:
    """Yield the best linear fits over phases in [0, π) and lengths of both constant stages, held values linked.

    The phase moves in steps of the sampling, so that z at the samples of each half is always the same, and the data roll.
    """
    m, n = len(y), degree + 1
    half = m // 2
    z = np.cos(np.pi * (np.arange(half) + 0.5) / half)  # down from 1; −z is the way up
    powers, sign = np.asarray(z[:, None] ** np.arange(n), float), (-1.0) ** np.arange(n)
    stages = np.unique(np.linspace(0, half - n - 2, STAGES).astype(int))
    offset = np.arange(half)  # samples before the first turn
    place = (offset[:, None] + np.arange(half)) % m
    down, up = y[place], y[(place + half) % m]  # (phases, half): both halves in time order
    follow = {"down": _tails(powers, down, stages), "up": _tails(powers * sign, up, stages)}
    held = {
        name: np.pad(np.cumsum(data, axis=1), ((0, 0), (1, 0)))[:, stages] for name, data in (("down", down), ("up", up))
    }
    gram = {name: _grams(p, stages) for name, p in (("down", powers), ("up", np.asarray(powers * sign, float)))}
    gain, solved = [], []
    for mine, other, at_turn in (
        ("up", "down", np.ones(n)),
        ("down", "up", sign),
    ):  # rising holds the top
        g = gram[mine][:, None] + stages[None, :, None, None] * np.outer(at_turn, at_turn)
        b = follow[mine][:, :, None, :] + held[other][:, None, :, None] * at_turn
        x = np.linalg.solve(g[None], b[..., None])[..., 0]  # (phases, own stage, other's stage, n)
        gain.append(np.sum(x * b, axis=-1))
        solved.append(x)
    total = gain[0] + gain[1].swapaxes(1, 2)  # (phases, stage on the way up, on the way down)
    order = np.argsort(-total, axis=None)
    seen = np.zeros(half, int)
    count = 0
    for flat in order[: 40 * TRIED]:
        p, i, j = np.unravel_index(flat, total.shape)
        if seen[p] >= EACH:
            continue
        seen[p] += 1
        count += 1
        phase = -2 * np.pi * (offset[p] - 0.5) / m
        yield float(phase), solved[0][p, i, j], solved[1][p, j, i]
        if count == TRIED:
            return


def _tails(powers: Floats, data: Floats, stages: np.ndarray) -> Floats:
    """Return Σ_{i ≥ s} powers_i data_i for every stage length s: (phases, stages, n)."""
    total = np.cumsum((data[:, :, None] * powers)[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(total[:, stages])


def _grams(powers: Floats, stages: np.ndarray) -> Floats:
    return np.array([powers[s:].T @ powers[s:] for s in stages])
