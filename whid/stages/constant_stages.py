"""The paper's least squares: constant stages read off the averaged period, then the borders at that phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.fit import Estimate, linear_least_squares
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._hysteresis import Lumped, Swing, lumped

FLAT = 6.0  # standard errors between the lowest and the highest sample of a constant stage
SHORTEST = 1 / 32  # of a period: less is the top of a sine
MOVES = 1e-4  # p below which half a period is no constant stage
ROUNDING = 1e-6  # of the output's range: as flat as noise-free data get


class Flat(NamedTuple):
    """Two stretches of a period, half a period apart, on which the output is constant; length 0: none."""

    start: int
    first: int  # samples from start
    second: int  # samples from start + M/2


class ConstantStages(NamedTuple):
    """Constant stages: phase by (23a) and lumped borders by (23b), one row a sine; NaN where there is no stage.

    phase_std is half a sample: the estimate has no other error of its own, but a bias of many.
    """

    omega: Annotated[Floats, Quantity("rad/s", ("sine",))]
    amplitude: Annotated[Floats, Quantity("input", ("sine",))]
    first: Annotated[Floats, Quantity("1", ("sine",))]  # length of the stages, of a period
    second: Annotated[Floats, Quantity("1", ("sine",))]
    phase: Annotated[Floats, Quantity("rad", ("sine",), error="phase_std")]
    phase_std: Annotated[Floats, Quantity("rad", ("sine",))]
    rising: Annotated[Floats, Quantity("output", ("sine", "power"), error="rising_std")]
    rising_std: Annotated[Floats, Quantity("output", ("sine", "power"))]
    falling: Annotated[Floats, Quantity("output", ("sine", "power"), error="falling_std")]
    falling_std: Annotated[Floats, Quantity("output", ("sine", "power"))]
    half: tuple[bool, ...]  # the output holds, but for noise, through one half of the sine: one border is never met

    def table(self) -> Table:
        """Return one row a sine."""
        rows = tuple(
            (float(f"{w:.6g}"), float(f"{u:.6g}"), float(f"{a:.3g}"), float(f"{b:.3g}"),
             Measured(float(p), float(s)) if np.isfinite(p) else None)
            for w, u, a, b, p, s in zip(
                self.omega, self.amplitude, self.first, self.second, self.phase, self.phase_std, strict=True
            )
        )  # fmt: skip
        columns = ("ω, rad/s", "amplitude", "first stage, periods", "second", "phase by (23a), rad")
        notes = ["noise makes a stage look longer: it seems to begin early"]
        if held := sum(self.half):
            notes.append(f"the output holds through one half of {held} of {len(self.half)} sines: one border is not met")
        return Table("Constant stages", columns, rows, tuple(notes))


def constant_stages(swings: Sequence[Swing], degree: int) -> ConstantStages:
    """Return (23): the phase is where a constant stage begins, the borders follow by least squares outside the stages.

    Table 1 corrected: the stage that begins with the falling half ends at τ_d, the other at τ_a (as printed the two are
    swapped). Source [Giri], Table 1, eqs. (18)-(23).

    >>> from whid.stages._hysteresis import response
    >>> theta = 2 * np.pi * np.arange(256) / 256
    >>> w, *_ = response(np.array([-0.2, 1.0]), np.array([0.2, 1.0]), theta - 0.5)
    >>> found = constant_stages([Swing(1.0, 1.0 + 0j, w, np.full(256, 1e-4), 20)], degree=1)
    >>> round(float(found.phase[0]), 1), found.falling[0].round(1)  # early by a hair
    (-0.5, array([0.2, 1. ]))
    """
    flats = [flat_stretches(swing) for swing in swings]
    found = [_fitted(swing, flat, degree) for swing, flat in zip(swings, flats, strict=True)]
    return ConstantStages(
        np.array([s.omega for s in swings]), np.array([s.amplitude for s in swings]),
        np.array([f.first / len(s.mean) for f, s in zip(flats, swings, strict=True)]),
        np.array([f.second / len(s.mean) for f, s in zip(flats, swings, strict=True)]),
        **{name: np.array([getattr(one, name) for one in found]) for name in Lumped._fields[2:]},
        half=tuple(_holds_a_half(s, f) for s, f in zip(swings, flats, strict=True)),
    )  # fmt: skip


def flat_stretches(swing: Swing) -> Flat:
    """Return the longest constant stretch of the period and the one half a period later, round the period's end."""
    y, m = swing.mean, len(swing.mean)
    width = max(FLAT * float(swing.std.mean()), ROUNDING * float(np.ptp(y)))
    length = _runs(y, width)
    start = int(np.argmax(length))
    if length[start] < SHORTEST * m:
        return Flat(start, 0, 0)
    late = np.arange(-m // 8, m // 8)
    other = length[(start + m // 2 + late) % m]
    best = int(np.argmax(other))
    second = int(late[best] + other[best]) if other[best] >= SHORTEST * m else 0
    return Flat(start, int(length[start]), max(second, 0))


def _holds_a_half(swing: Swing, flat: Flat) -> bool:
    """Tell whether a stage is half a period long, and its scatter that of the noise."""
    from scipy.special import chdtrc

    half = len(swing.mean) // 2
    place = (flat.start + np.arange(half)) % len(swing.mean)
    y, std = swing.mean[place], swing.std[place]
    return flat.first >= half and bool(chdtrc(half - 1, np.sum(((y - y.mean()) / std) ** 2)) > MOVES)


def outside(swing: Swing, flat: Flat) -> NDArray[np.bool_]:
    """Return which samples lie in neither stage."""
    place = (np.arange(len(swing.mean)) - flat.start) % len(swing.mean)
    return ~((place < flat.first) | ((place >= len(place) // 2) & (place < len(place) // 2 + flat.second)))


def border_rows(angle: Floats, degree: int) -> Floats:
    """Return X(t, ψ) of (15b): powers of cos for the rising border where cos rises, for the falling one where it falls."""
    powers = np.cos(angle)[:, None] ** np.arange(degree + 1)
    down = (np.sin(angle) >= 0)[:, None]
    return np.hstack([np.where(down, 0.0, powers), np.where(down, powers, 0.0)])


def _runs(y: Floats, width: float) -> NDArray[np.intp]:
    """Return for every sample how many from it on lie within a width, half a period at most."""
    m = len(y)
    doubled, longest = np.concatenate([y, y]), m // 2
    low, high, length = y.copy(), y.copy(), np.ones(m, np.intp)
    open_ = np.ones(m, bool)
    for k in range(1, longest):
        following = doubled[np.arange(m) + k]
        low, high = np.minimum(low, following), np.maximum(high, following)
        open_ &= high - low <= width
        if not open_.any():
            break
        length += open_
    return length


def _fitted(swing: Swing, flat: Flat, degree: int) -> Lumped:
    n = degree + 1
    if not flat.first:
        nothing = np.full(n, np.nan)
        return Lumped(swing.omega, swing.amplitude, np.nan, np.nan, nothing, nothing, nothing, nothing)
    step = 2 * np.pi / len(swing.mean)
    phase = -(swing.angle[0] + step * flat.start)
    keep = outside(swing, flat)
    design = border_rows(swing.angle + phase + 1e-9, degree)[keep]
    found = linear_least_squares(design, swing.mean[keep], 1 / swing.std[keep])
    whole: Estimate = found._replace(values=np.append(phase, found.values), std=np.append(step / 2, found.std))
    return lumped(whole, swing.omega, swing.amplitude)
