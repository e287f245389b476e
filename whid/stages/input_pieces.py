"""Input nonlinearity: value and slope of every affine piece behind a known output, and what happens at each junction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from whid.fit import Estimate
from whid.quantity import Measured, Quantity, Table
from whid.signal import Floats
from whid.stages._affine_fit import Affine, AffineFit, Levels, Tones, real_roots

JUMP = 12.0  # χ² that a jump must be worth; and by which a rival reading of a piece must be worse
POLISHED = 6  # starts of a piece that are fitted
KEPT = 5  # readings of the pieces so far that are followed
HOPELESS = 40.0  # χ² above the best at which a reading is dropped
SLOPES = np.concatenate([-np.geomspace(0.03, 10.0, 26)[::-1], np.geomspace(0.03, 10.0, 26)])  # of the anchor's
UNEXPLAINED = 1e-4  # p of χ² below which the readings are in doubt; the noise has some 36 degrees of freedom itself
UNSURE = 3.0  # standard errors of a level within which f may turn without being seen


class InputPieces(NamedTuple):
    """Input nonlinearity: x = value + slope·(u − centre) on every piece, in input units of the anchor (slope 1)."""

    centre: Annotated[Floats, Quantity("input", ("piece",))]
    value: Annotated[Floats, Quantity("input", ("piece",), error="value_std")]
    value_std: Annotated[Floats, Quantity("input", ("piece",))]
    slope: Annotated[Floats, Quantity("1", ("piece",), error="slope_std")]
    slope_std: Annotated[Floats, Quantity("1", ("piece",))]
    anchor: int
    breaks: Annotated[Floats, Quantity("input", ("break",), error="break_std")]
    break_std: Annotated[Floats, Quantity("input", ("break",))]
    jump: Annotated[NDArray[np.bool_], Quantity("1", ("break",))]
    jump_size: Annotated[Floats, Quantity("input", ("break",))]  # right minus left at the break
    rivals: Annotated[Floats, Quantity("input", ("piece", "rival"))]  # other values at the centre that fit as well, else NaN
    rival_slopes: Annotated[Floats, Quantity("1", ("piece", "rival"))]
    resolved: Annotated[NDArray[np.bool_], Quantity("1", ("piece",))]  # False: f turns within the noise of this piece
    estimate: Estimate

    @property
    def ambiguous(self) -> NDArray[np.intp]:
        """Return the pieces of which another reading fits as well."""
        return np.flatnonzero(np.isfinite(self.rivals).any(axis=1))

    def table(self) -> Table:
        """Return one row a piece, with the break that ends it."""
        rows = []
        for k in range(len(self.centre)):
            end = ("", None) if k == len(self.breaks) else (
                "jump" if self.jump[k] else "kink", Measured(float(self.breaks[k]), float(self.break_std[k]))
            )  # fmt: skip
            value = Measured(float(self.value[k]), float(self.value_std[k])) if k != self.anchor else 0.0
            slope = Measured(float(self.slope[k]), float(self.slope_std[k])) if self.slope_std[k] else float(self.slope[k])
            rows.append((float(f"{self.centre[k]:.6g}"), value, slope, *end))
        e = self.estimate
        notes = [f"slope 1 and x = 0 at the middle of piece {self.anchor + 1}; χ²/dof {e.chi2:.1f}/{e.dof}", *self.unknown()]
        return Table(
            "Input nonlinearity", ("centre, input", "x there", "slope", "ends in", "at, input"), tuple(rows), tuple(notes)
        )

    def unknown(self) -> tuple[str, ...]:
        """Return what the data leave open about pieces."""
        said = [
            f"piece not resolved: about u = {self.centre[k]:.4g} the output nonlinearity turns within the noise, so that h "
            "may be flat, rise or fall there: hold longer, or average more periods"
            for k in np.flatnonzero(~self.resolved)
        ]
        for k in self.ambiguous:
            others = ", ".join(f"{v:.4g}" for v in self.rivals[k][np.isfinite(self.rivals[k])])
            said.append(
                f"piece about u = {self.centre[k]:.4g}: x = {others} gives the same levels as {self.value[k]:.4g}; a square "
                "wave between it and the anchor tells them apart"
            )
        from scipy.special import chdtrc

        e = self.estimate
        if e.dof > 0 and chdtrc(e.dof, e.chi2) < UNEXPLAINED:
            said.append(
                f"piece not resolved, or read wrongly: levels and sines together are not explained, χ²/dof "
                f"{e.reduced_chi2:.3g}; hold longer, or average more periods"
            )
        return tuple(said)


class Choice(NamedTuple):
    """What is known of the pieces from the outside: the levels and sines on them, which are flat, and their borders."""

    levels: Levels
    tones: Tones
    flat: NDArray[np.bool_]  # (P,)
    borders: Floats  # (P − 1, 2): last level left, first level right


def input_pieces(
    anchor: AffineFit, known: Choice, forced: dict[int, tuple[float, float]] | None = None
) -> tuple[InputPieces, AffineFit]:
    """Find value and slope of every piece, nearest to the anchor first, each fitted jointly with all before it.

    Starts of a piece: the local minima of its levels' χ² over a grid of values and 52 slopes; of a flat one the real roots
    of f(x) = mean. The five best readings of the pieces so far are followed, by χ² + 12·(junctions that jump): what f was on
    one piece alone is too uncertain far away to decide at once. Those within 12 of the best in the end are rivals. A
    junction is continuous where its pieces meet inside its gap, or nearly, for χ² < 12. A piece is not resolved where f has
    an extremum within 3 standard errors of its levels, so that flat and sloped look alike.
    forced: (value, slope) at the centre of a piece, decided elsewhere (the audit).
    Source [Brouri2014], section 4.3, eqs. (25)-(28) corrected: a slope is in the stretch of the curve, not its crossings.
    """
    count = len(known.flat)
    readings = [anchor]
    ends: list[tuple[float, AffineFit]] = [(0.0, anchor)]
    for number in sorted(set(range(count)) - {anchor.anchor}, key=lambda p: (abs(p - anchor.anchor), p)):
        here = known.levels.piece == number
        own = Levels(*(each[here] for each in known.levels))
        tones = known.tones.of((known.tones.piece == number) & np.isin(known.tones.omega, anchor.omegas))
        found: list[tuple[float, AffineFit]] = []
        for fit in readings:
            if forced and number in forced:
                starts = [forced[number]]
            else:
                starts = _roots(fit, own) if known.flat[number] else _minima(fit, own)
            found += [end for end in _fitted(fit, number, own, tones, starts, known) if not _among(end[1], found)]
        ends = sorted(found, key=lambda end: end[0])
        readings = [fit for cost, fit in ends[:KEPT] if cost < ends[0][0] + HOPELESS]
    estimate, best = readings[0].solve()
    return _result(estimate, best, known, [fit for cost, fit in ends[1:] if cost < ends[0][0] + JUMP]), best


def _fitted(
    fit: AffineFit, number: int, own: Levels, tones: Tones, starts: Sequence[tuple[float, float]], known: Choice
) -> Iterator[tuple[float, AffineFit]]:
    """Yield (cost, fit) of one more piece from each start."""
    levels = Levels(*(np.concatenate(pair) for pair in zip(fit.levels, own, strict=True)))
    both = Tones(*(np.concatenate(pair) for pair in zip(fit.tones, tones, strict=True)))
    centre = float(own.level.min() + own.level.max()) / 2
    for value, slope in starts:
        piece = Affine(centre, value, slope, bool(known.flat[number]))
        trial = replace(fit, levels=levels, tones=both, pieces={**fit.pieces, number: piece})
        estimate, trial = trial.solve(30)
        if np.isfinite(estimate.chi2):
            pairs = [left for left in trial.pieces if left + 1 in trial.pieces]
            jumps = sum(not _meet(estimate, trial, left, left + 1, known.borders[left])[1] for left in pairs)
            yield estimate.chi2 + JUMP * jumps, trial


def _among(fit: AffineFit, found: Sequence[tuple[float, AffineFit]]) -> bool:
    """Tell whether another fit ended at the same pieces."""
    return any(all(_same(piece, other.pieces[k]) for k, piece in fit.pieces.items()) for _, other in found)


def _same(a: Affine, b: Affine) -> bool:
    return abs(a.value - b.value) + abs(a.slope - b.slope) < 1e-3 * (1 + abs(b.value))


def _roots(fit: AffineFit, own: Levels) -> list[tuple[float, float]]:
    """Return (x, 0) for every real root of f(x) = mean; without one, where f comes nearest."""
    weight = own.std**-2
    shifted = poly.polysub(fit.coefficients, [float(weight @ own.mean / weight.sum())])
    real = real_roots(shifted)
    if not len(real):
        turning = np.append(real_roots(poly.polyder(fit.coefficients)), 0.0)
        real = turning[[int(np.argmin(np.abs(np.asarray(poly.polyval(turning, shifted)))))]]
    return [(float(x), 0.0) for x in real]


def _minima(fit: AffineFit, own: Levels) -> list[tuple[float, float]]:
    """Return (value, slope) of the best local minima of the levels' χ² on a grid, a flat start among them."""
    x = np.array([fit.pieces[p].at(u) for p, u in zip(fit.levels.piece, fit.levels.level, strict=True)])
    low, width = x.min(), np.ptp(x)
    values = np.linspace(low - 1.5 * width, low + 2.5 * width, 241)
    away = own.level - (own.level.min() + own.level.max()) / 2
    inner = values[:, None, None] + SLOPES[:, None] * away
    with np.errstate(over="ignore"):
        cost = np.sum(((poly.polyval(inner, fit.coefficients) - own.mean) / own.std) ** 2, axis=2)
    padded = np.pad(cost, 1, constant_values=np.inf)
    least = np.ones(cost.shape, bool)
    for i in (0, 1, 2):
        for j in (0, 1, 2):
            least &= cost <= padded[i : i + cost.shape[0], j : j + cost.shape[1]]
    places = np.argwhere(least)
    order = np.argsort(cost[least])[:POLISHED]
    return [(float(values[i]), float(SLOPES[j])) for i, j in places[order]]


def _meet(estimate: Estimate, fit: AffineFit, left: int, right: int, gap: Floats) -> tuple[float, bool, float]:
    """Return where two pieces meet (the middle of the gap at a jump), whether they do, and the error of that place."""
    a, b = fit.pieces[left], fit.pieces[right]
    rate = b.slope - a.slope
    at = a.centre + (b.value - a.value + b.slope * (a.centre - b.centre)) / -rate if rate else np.nan
    if gap[0] <= at <= gap[1]:
        return float(at), True, _std(estimate, fit, left, right, float(at)) / abs(rate)
    ends = [float(gap[np.argmin(np.abs(gap - at))])] if np.isfinite(at) else [float(gap.mean())]
    cost = [((b.at(z) - a.at(z)) / max(_std(estimate, fit, left, right, z), 1e-300)) ** 2 for z in ends]
    if min(cost) < JUMP and rate and abs(at - gap.mean()) < 2 * np.ptp(gap) + 1e-300:
        return float(at), True, _std(estimate, fit, left, right, float(at)) / abs(rate)
    return float(gap.mean()), False, float(np.ptp(gap) / np.sqrt(12))


def _std(estimate: Estimate, fit: AffineFit, left: int, right: int, z: float) -> float:
    """Return the standard error of right − left at z."""
    row = np.zeros(len(estimate.names))
    for number, sign in ((left, -1.0), (right, 1.0)):
        for name, rate in ((f"h.{number}.value", 1.0), (f"h.{number}.slope", z - fit.pieces[number].centre)):
            if name in estimate.names:
                row[estimate.names.index(name)] = sign * rate
    return float(np.sqrt(max(float(row @ estimate.covariance @ row), 0.0)))


def _is_resolved(fit: AffineFit, number: int) -> bool:
    """Tell whether f turns nowhere within the noise of a flat piece's levels."""
    here = fit.levels.piece == number
    if not fit.pieces[number].flat:
        return True
    turning = real_roots(poly.polyder(fit.coefficients))
    mean, std = float(np.mean(fit.levels.mean[here])), float(np.sqrt(np.mean(fit.levels.std[here] ** 2)))
    return not bool((np.abs(np.asarray(poly.polyval(turning, fit.coefficients)) - mean) < UNSURE * std).any())


def _result(estimate: Estimate, fit: AffineFit, known: Choice, rivals: Sequence[AffineFit]) -> InputPieces:
    numbers = range(len(known.flat))
    pieces = [fit.pieces[k] for k in numbers]
    error = dict(zip(estimate.names, estimate.std, strict=True))
    met = [_meet(estimate, fit, k, k + 1, known.borders[k]) for k in numbers[:-1]]
    others = np.full((2, len(pieces), len(rivals)), np.nan)
    for j, rival in enumerate(rivals):
        for k in numbers:
            away = rival.pieces[k].value - pieces[k].value, rival.pieces[k].slope - pieces[k].slope
            if abs(away[0]) > 5 * error.get(f"h.{k}.value", np.inf) or abs(away[1]) > 5 * error.get(f"h.{k}.slope", np.inf):
                others[:, k, j] = rival.pieces[k].value, rival.pieces[k].slope
    size = [float(pieces[k + 1].at(b) - pieces[k].at(b)) if not kink else 0.0 for k, (b, kink, _) in enumerate(met)]
    return InputPieces(
        np.array([p.centre for p in pieces]), np.array([p.value for p in pieces]),
        np.array([error.get(f"h.{k}.value", 0.0) for k in numbers]), np.array([p.slope for p in pieces]),
        np.array([error.get(f"h.{k}.slope", 0.0) for k in numbers]), fit.anchor,
        np.array([m[0] for m in met]), np.array([m[2] for m in met]), np.array([not m[1] for m in met], bool),
        np.array(size), others[0], others[1], np.array([_is_resolved(fit, k) for k in numbers]), estimate,
    )  # fmt: skip
