"""The paper's last step: gain modulus and border coefficients of every sine from its lumped parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._hysteresis import Lumped, other_branch
from whid.stages.identifiability import distinct
from whid.stages.joint_loops import paper_scale, wrapped


class PaperBorders(NamedTuple):
    """Borders by (35)-(37), one row a sine, each on the branch of the first; the d_i divided by the sum of the α too."""

    omega: Annotated[Floats, Quantity("rad/s", ("sine",))]
    amplitude: Annotated[Floats, Quantity("input", ("sine",))]
    gain: Annotated[Floats, Quantity("1/input", ("sine",), error="gain_std")]
    gain_std: Annotated[Floats, Quantity("1/input", ("sine",))]
    phase: Annotated[Floats, Quantity("rad", ("sine",), error="phase_std")]
    phase_std: Annotated[Floats, Quantity("rad", ("sine",))]
    rising: Annotated[Floats, Quantity("output", ("sine", "power"), error="rising_std")]
    rising_std: Annotated[Floats, Quantity("output", ("sine", "power"))]
    falling: Annotated[Floats, Quantity("output", ("sine", "power"), error="falling_std")]
    falling_std: Annotated[Floats, Quantity("output", ("sine", "power"))]

    def table(self) -> Table:
        """Return one row a sine."""
        rows = tuple(
            (float(f"{w:.6g}"), float(f"{u:.6g}"), Measured(float(g), float(gs)), Measured(float(p), float(ps)))
            for w, u, g, gs, p, ps in zip(
                self.omega, self.amplitude, self.gain, self.gain_std, self.phase, self.phase_std, strict=True
            )
        )
        return Table("Borders as in the paper", ("ω, rad/s", "amplitude", "|G| by (35)", "phase, rad"), rows)

    def metrics(self) -> dict[str, Measured]:
        """Return `paper.linear.gain@ω` and so on of the sine of largest amplitude, the borders of its first."""
        made: dict[str, Measured] = {}
        seen = np.isfinite(self.gain)
        for w in distinct(self.omega):
            mine = [k for k in np.flatnonzero(seen) if np.isclose(self.omega[k], w)]
            if mine:
                k = max(mine, key=lambda i: self.amplitude[i])
                made[f"paper.linear.gain@{w:.6g}"] = Measured(float(self.gain[k]), float(self.gain_std[k]))
                made[f"paper.linear.phase@{w:.6g}"] = Measured(float(self.phase[k]), float(self.phase_std[k]))
        if seen.any():
            k = max(np.flatnonzero(seen), key=lambda i: (self.amplitude[i], -self.omega[i]))
            for side in ("rising", "falling"):
                for i, (v, s) in enumerate(zip(getattr(self, side)[k], getattr(self, f"{side}_std")[k], strict=True)):
                    made[f"paper.{side}.{i}"] = Measured(float(v), float(s))
        return made


def paper_borders(sines: Sequence[Lumped]) -> PaperBorders:
    """Return |G| = (Σ|α_i|^{n/i})^{1/n}/U, a_i = α_i/(U|G|)ⁱ, d_i = δ_i/(U|G|)ⁱ, a_0 = α_0, d_0 = δ_0.

    (37) as printed divides the δ_i by their own sum, which contradicts (34a). The branch comes first, since the other one
    has another sum ((30a) and (32) take both for equal): that of the lowest frequency has its phase nearest 0, the
    others are on the branch where their borders are nearest to the first's. Errors to first order, those of the lumped.
    Source [Giri], eqs. (28)-(37).
    """
    order = np.argsort([s.omega for s in sines], kind="stable")
    first: Lumped | None = None
    placed: dict[int, tuple[Lumped, float]] = {}
    for k in order:
        one = sines[k]
        if np.isfinite(one.phase):
            first = first or (one if abs(wrapped(np.array([one.phase]))[0]) <= np.pi / 2 else other_branch(one))
            one = _nearer(one, other_branch(one), first)
        placed[k] = (one, 1 / paper_scale(one.rising, one.falling) if np.isfinite(one.phase) else np.nan)
    rows = [_row(*placed[k]) for k in range(len(sines))]
    return PaperBorders(
        np.array([s.omega for s in sines]), np.array([s.amplitude for s in sines]),
        *(np.array(column) for column in zip(*rows, strict=True)),
    )  # fmt: skip


def _nearer(one: Lumped, other: Lumped, first: Lumped) -> Lumped:
    return one if _apart(one, first) <= _apart(other, first) else other


def _apart(one: Lumped, first: Lumped) -> float:
    """Return how far the borders, each in its own paper's scale, are from the first's over the unit interval."""
    z = np.linspace(-1, 1, 41)[:, None] ** np.arange(len(one.rising))
    a, b = _scaled(one), _scaled(first)
    return float(sum(np.sum((z @ (x - y)) ** 2) for x, y in zip(a, b, strict=True)))


def _scaled(one: Lumped) -> tuple[Floats, Floats]:
    shape = paper_scale(one.rising, one.falling) ** np.arange(len(one.rising))
    return one.rising * shape, one.falling * shape


def _row(one: Lumped, size: float) -> tuple[object, ...]:
    n = len(one.rising) - 1
    i = np.arange(1, n + 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.abs(one.rising[1:]) ** (n / i - 1) / i / size**n * size  # ∂size/∂|α_i|
    size_std = float(np.sqrt(np.sum((share * one.rising_std[1:]) ** 2)))
    rising, falling = _scaled(one) if np.isfinite(size) else (one.rising, one.falling)
    shape = size ** -np.arange(n + 1.0)
    moved = np.arange(n + 1) * size_std / size
    return (
        size / one.amplitude, size_std / one.amplitude, float(wrapped(np.array([one.phase]))[0]), one.phase_std,
        rising, np.hypot(one.rising_std * shape, moved * rising),
        falling, np.hypot(one.falling_std * shape, moved * falling),
    )  # fmt: skip
