"""What sines can and cannot tell about the phases of two linear blocks around a nonlinearity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whid.quantity import Quantity, Table

Floats = NDArray[np.float64]


class Identifiability(NamedTuple):
    """Rank of the phase equations arg H_k(ω) = k·φ_front(ω) + φ_back(kω), and what it means.

    rank of unknowns counts the harmonics that are there; paper_rank of paper_unknowns those that a polynomial of the
    paper's degree would give. A group holds the frequencies that harmonics connect; each group leaves one phase free.
    """

    unknown: tuple[str, ...]
    equations: Annotated[Floats, Quantity(dims=("equation", "unknown"))]
    rank: int
    nullity: int
    null_directions: Annotated[Floats, Quantity("rad", dims=("null", "unknown"))]
    groups: tuple[tuple[float, ...], ...]
    paper_unknowns: int
    paper_rank: int
    not_measured: tuple[str, ...]
    invariant: Annotated[tuple[str, ...], Quantity(dims=("invariant",))]

    def table(self) -> Table:
        """Return the report in words."""
        unknowns = len(self.unknown)
        groups = "; ".join(", ".join(f"{w:g}" for w in group) for group in self.groups)
        rows: list[tuple[str, str]] = [
            ("phase equations, harmonics present", f"rank {self.rank} of {unknowns}"),
            ("phase equations, every harmonic to the paper's degree", f"rank {self.paper_rank} of {self.paper_unknowns}"),
            ("connected groups of frequencies, rad/s", groups),
        ]
        rows += [("not measured", reason) for reason in self.not_measured]
        note = "" if not self.nullity else (
            f"{self.nullity} free direction{'s' * (self.nullity > 1)}: a delay may move between front and back"
            f"{', one a group' * (self.nullity > 1)}; only a parametric model (the gauge) decides"
        )  # fmt: skip
        return Table("Identifiability", ("what", "finding"), tuple(rows), (note,) if note else ())


def identifiability(
    omega: Floats, orders: Sequence[Sequence[int]], paper_degree: int = 3, wanted: int | None = None
) -> Identifiability:
    """Return rank, null directions and connected groups of the phase system of sines at omega (E,), rad/s.

    orders: for each sine the harmonics k ≥ 1 that are there. wanted: the highest harmonic a reader would ask for; what of
    it was not observed is listed with its reason. Source [Brouri2019], after eq. (4.5): its 9 × 9 system has rank 8.

    >>> report = identifiability(np.array([0.02, 0.04, 0.06]), [(1, 2)] * 3)
    >>> report.rank, len(report.unknown), report.paper_rank, report.paper_unknowns
    (6, 8, 8, 9)
    """
    every = tuple(tuple(int(k) for k in ks) for ks in orders)
    return _report(tuple(float(w) for w in omega), every, paper_degree, wanted)


@lru_cache(maxsize=32)  # repeats of one plan ask the same
def _report(
    omegas: tuple[float, ...], orders: tuple[tuple[int, ...], ...], paper_degree: int, wanted: int | None
) -> Identifiability:
    omega = np.array(omegas)
    names, matrix, groups = phase_system(omega, orders)
    paper_names, paper_matrix, _ = phase_system(omega, [range(1, paper_degree + 1)] * len(omega))
    rank = int(np.linalg.matrix_rank(matrix)) if matrix.size else 0
    observed = distinct(np.array([k * w for w, ks in zip(omega, orders, strict=True) for k in ks]))
    unseen = [
        (w, k)
        for w, ks in zip(omega, orders, strict=True)
        for k in range(1, (wanted or paper_degree) + 1)
        if k not in ks and not np.any(np.isclose(observed, k * w, rtol=1e-6))
    ]
    missing = [
        f"G_back at {', '.join(f'{k * w:.6g}' for w, order in unseen if order == k)} rad/s: "
        f"only harmonic {k} of a sine would reach it, and the nonlinearity makes no harmonic {k} there"
        for k in dict.fromkeys(order for _, order in unseen)
    ]
    null = np.linalg.svd(matrix)[2][rank:] if matrix.size else np.eye(len(names))
    invariant = tuple(f"{_combination(row, names)}" for row in matrix)
    return Identifiability(
        names, matrix, rank, len(names) - rank, null, groups, len(paper_names),
        int(np.linalg.matrix_rank(paper_matrix)), tuple(missing), invariant,
    )  # fmt: skip


def phase_system(
    omega: Floats, orders: Sequence[Sequence[int]]
) -> tuple[tuple[str, ...], Floats, tuple[tuple[float, ...], ...]]:
    """Return (names of the unknown phases, equations as a matrix, connected groups of frequencies)."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    pairs = [(e, k) for e, ks in enumerate(orders) for k in ks]
    fronts = distinct(np.asarray(omega, float))
    backs = distinct(np.array([k * omega[e] for e, k in pairs]))
    matrix = np.zeros((len(pairs), len(fronts) + len(backs)))
    for row, (e, k) in enumerate(pairs):
        matrix[row, nearest(fronts, omega[e])] = k
        matrix[row, len(fronts) + nearest(backs, k * omega[e])] = 1
    names = tuple(f"phase_front({w:.6g})" for w in fronts) + tuple(f"phase_back({w:.6g})" for w in backs)
    _, label = connected_components(csr_array(matrix.T @ matrix != 0), directed=False)
    frequency = np.concatenate([fronts, backs])
    groups = tuple(tuple(float(w) for w in distinct(frequency[label == g])) for g in dict.fromkeys(label))
    return names, matrix, groups


def distinct(omega: Floats) -> Floats:
    """Return the different frequencies, ascending; closer than 1e-6 of each other is the same."""
    ordered = np.sort(omega)
    return ordered[np.append(True, np.diff(ordered) > 1e-6 * ordered[1:])] if len(ordered) else ordered


def nearest(frequencies: Floats, omega: Floats | float) -> NDArray[np.intp]:
    """Return the place of each frequency among the distinct ones."""
    return np.asarray(np.abs(np.subtract.outer(omega, frequencies)).argmin(axis=-1))


def _combination(row: Floats, names: tuple[str, ...]) -> str:
    return " + ".join((f"{c:g}·" if c != 1 else "") + name for c, name in zip(row, names, strict=True) if c)
