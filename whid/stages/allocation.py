"""Which poles and zeros of a linear approximation stand in front of the nonlinearity, and which behind it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.errors import WhidError
from whid.fit import linear_least_squares
from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages._cascade import Filter, filtered

Complexes = NDArray[np.complex128]
MOST = 4000  # splits that are tried; the number doubles with every pole and zero


class Split(NamedTuple):
    """One way to share poles and zeros, and the curve of straight lines that suits it best."""

    front: Filter
    back: Filter
    points: Floats  # (K,) levels between the filters
    heights: Floats  # (K,) the curve there
    rms: float


class Allocation(NamedTuple):
    """All ways to share poles and zeros between front and back, the best first, each with the error that it leaves."""

    front_poles: Annotated[NDArray[np.intp], Quantity(dims=("split",))]
    front_zeros: Annotated[NDArray[np.intp], Quantity(dims=("split",))]
    rms: Annotated[Floats, Quantity("output", ("split",))]
    linear: Annotated[float, Quantity("output")]  # what the linear approximation leaves
    best: tuple[Split, ...]

    def table(self) -> Table:
        """Return the first few."""
        rows = tuple(
            (int(p), int(z), float(f"{e:.4g}"))
            for p, z, e in zip(self.front_poles[:6], self.front_zeros[:6], self.rms[:6], strict=True)
        )
        note = f"{len(self.rms)} splits tried; a straight line leaves {self.linear:.4g}"
        return Table("Allocation", ("poles in front", "zeros in front", "rms"), rows, (note,))


def allocation(
    u: Floats,
    y: Floats,
    use: NDArray[np.bool_],
    roots: Iterable[tuple[Complexes, Complexes]],
    orders: tuple[int, int] | None = None,
    both: bool = False,
    keep: int = 4,
    hinges: int = 8,
) -> Allocation:
    """Score every split by linear least squares: y on hinge functions of front's output, each passed through back.

    u, y (N,); use (N,) where y counts; roots (zeros, poles) to share, complex pairs stay together; orders: poles in front
    and behind, left out: any; both: neither side empty. A block has no more zeros than poles, but for one without poles.
    Raises `WhidError("stage-no-split")` where the poles cannot be shared so.
    """
    found: list[tuple[int, int, Split]] = []
    for zeros, poles in roots:
        for (front_z, front_p), (back_z, back_p) in _shared(zeros, poles, orders):
            if both and not (len(front_p) and len(back_p)):
                continue
            front, back = Filter.of_roots(front_z, front_p), Filter.of_roots(back_z, back_p)
            if np.all(np.isfinite(np.concatenate([*front, *back]))):  # a zero at frequency zero leaves no static gain
                found.append((len(front_p), len(front_z), _scored(u, y, use, front, back, hinges)))
    if not found:
        asked = "so many" if orders is None else f"{orders[0]} in front and {orders[1]} behind"
        raise WhidError("stage-no-split", f"the poles cannot be shared: {asked}")
    found.sort(key=lambda item: item[2].rms)
    straight = min(_scored(u, y, use, s.front, s.back, 0).rms for _, _, s in found[:1])
    poles_in_front, zeros_in_front = (np.array([item[k] for item in found]) for k in (0, 1))
    rms = np.array([split.rms for _, _, split in found])
    return Allocation(poles_in_front, zeros_in_front, rms, straight, tuple(split for _, _, split in found[:keep]))


def _shared(
    zeros: Complexes, poles: Complexes, orders: tuple[int, int] | None
) -> Iterator[tuple[tuple[Complexes, Complexes], tuple[Complexes, Complexes]]]:
    ways = list(_divided(_groups(zeros)))
    count = 0
    for front_p, back_p in _divided(_groups(poles)):
        if orders is not None and (len(front_p), len(back_p)) != orders:
            continue
        for front_z, back_z in ways:
            if len(front_z) <= max(len(front_p), 0) and len(back_z) <= max(len(back_p), 0):
                yield (front_z, front_p), (back_z, back_p)
                count += 1
                if count >= MOST:
                    return


def _divided(groups: Sequence[Complexes]) -> Iterator[tuple[Complexes, Complexes]]:
    seen = set()
    for side in product((True, False), repeat=len(groups)):
        front = _joined([g for g, s in zip(groups, side, strict=True) if s])
        back = _joined([g for g, s in zip(groups, side, strict=True) if not s])
        if (key := tuple(np.round(front, 9))) not in seen:  # a double pole gives every split twice
            seen.add(key)
            yield front, back


def _joined(groups: list[Complexes]) -> Complexes:
    return np.concatenate([*groups, np.empty(0, complex)])


def _groups(roots: Complexes) -> list[Complexes]:
    """Return real roots one by one and complex ones in pairs."""
    real = [np.array([r.real + 0j]) for r in roots if abs(r.imag) <= 1e-9 * abs(r)]
    return real + [np.array([r, r.conj()]) for r in roots if r.imag > 1e-9 * abs(r)]


def _scored(u: Floats, y: Floats, use: NDArray[np.bool_], front: Filter, back: Filter, hinges: int) -> Split:
    v = filtered(front.num_z, front.den_z, u)
    points = np.linspace(v.min(), v.max(), hinges + 2)
    basis = np.vstack([np.ones(len(v)), v, *(np.maximum(v - point, 0.0) for point in points[1:-1])])
    design = filtered(back.num_z, back.den_z, basis).T[use]
    weights = linear_least_squares(design, y[use]).values
    error = y[use] - design @ weights
    heights = weights[0] + weights[1] * points + np.maximum(points[:, None] - points[1:-1], 0.0) @ weights[2:]
    return Split(front, back, points, heights, float(np.sqrt(np.mean(error**2))))
