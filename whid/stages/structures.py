"""Which structure: filters and curves in other orders, compared on data that none of them was fitted to, or by BIC."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from whid.quantity import Quantity, Table
from whid.signal import Floats
from whid.stages._cascade import Cascade, Filter
from whid.stages.cascade_fit import Window, bic, errors, rms_error
from whid.stages.descent import Counts

STRETCHES = 20  # whose mean squares scatter as one error of many samples does, coloured or not
SURE = 2.0  # standard errors by which a larger model must be better


class Structures(NamedTuple):
    """What each structure leaves over where it was fitted and on selection parts (NaN without), and which was taken."""

    structure: tuple[str, ...]
    numbers: Annotated[Counts, Quantity(dims=("candidate",))]  # that the fit could change
    rms: Annotated[Floats, Quantity("output", ("candidate",))]
    selection: Annotated[Floats, Quantity("output", ("candidate",))]
    bic: Annotated[Floats, Quantity(dims=("candidate",))]
    chosen: int

    def table(self) -> Table:
        """Return one row a candidate."""
        judged = np.isfinite(self.selection).all()
        rows = tuple(
            (name, int(n), float(f"{e:.5g}"), float(f"{s:.5g}"), float(f"{b:.7g}"), "taken" if k == self.chosen else "")
            for k, (name, n, e, s, b) in enumerate(
                zip(self.structure, self.numbers, self.rms, self.selection, self.bic, strict=True)
            )
        )
        note = f"on selection parts, a larger one must be better by {SURE:g} standard errors" if judged else "by BIC"
        return Table("Structures", ("structure", "numbers", "rms", "rms, selection", "BIC", ""), rows, (note,))


def structures(windows: Sequence[Window], kept: Sequence[Window], candidates: Sequence[Cascade]) -> Structures:
    """Compare candidates, the smallest first; a larger one takes its place where it is `better`."""
    order = sorted(range(len(candidates)), key=lambda k: int(candidates[k].free.sum()))
    chosen = order[0]
    for k in order[1:]:
        if better(windows, kept, candidates[k], candidates[chosen]):
            chosen = k
    return Structures(
        tuple(named(c) for c in candidates), np.array([int(c.free.sum()) for c in candidates]),
        np.array([rms_error(windows, c) for c in candidates]),
        np.array([rms_error(kept, c) if kept else np.nan for c in candidates]),
        np.array([bic(windows, c) for c in candidates]), chosen,
    )  # fmt: skip


def better(windows: Sequence[Window], kept: Sequence[Window], larger: Cascade, smaller: Cascade) -> bool:
    """Tell whether a larger model is worth its numbers: its error on `kept` lower by two standard errors, or its BIC lower.

    The standard error is that of the difference of squares over twenty stretches.
    """
    if not kept:
        return bic(windows, larger) < bic(windows, smaller)
    gain = np.concatenate([a**2 - b**2 for a, b in zip(errors(kept, smaller), errors(kept, larger), strict=True)])
    means = np.array([part.mean() for part in np.array_split(gain, min(STRETCHES, len(gain)))])
    return bool(means.mean() > SURE * means.std(ddof=1) / np.sqrt(len(means)))


def named(cascade: Cascade) -> str:
    """Return the structure of a cascade in words: poles of each filter, f for a curve.

    >>> from whid.blocks.polynomial import Polynomial
    >>> named(Cascade((Filter(np.empty(0), np.array([0.5])), Polynomial(coefficients=(0.0, 1.0)))))
    'wiener, 1 · f'
    """
    marks: list[str] = []
    for part in cascade.parts:
        mark = str(len(part.den)) if isinstance(part, Filter) else "f"
        if mark != "f" or marks[-1:] != ["f"]:  # a corner and the line behind it are one curve
            marks.append(mark)
    kinds = "".join("f" if mark == "f" else "g" for mark in marks)
    names = {"gf": "wiener", "fg": "hammerstein", "gfg": "wiener-hammerstein", "fgf": "hammerstein-wiener"}
    return f"{names.get(kinds, 'chain')}, {' · '.join(marks)}"
