"""Putting stage results together into a Model, with one covariance over the tree's parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from whid.blocks._block import Block
from whid.blocks.linear import Linear
from whid.blocks.piecewise import Piecewise
from whid.blocks.table import Table
from whid.methods._method import Model
from whid.stages._responses import StaticPart
from whid.stages._visits import pooled
from whid.stages.best_linear import Complexes
from whid.stages.lags import Lags
from whid.stages.levels import StaticCurve
from whid.stages.rational import Orders, Rational
from whid.stages.segmentation import Segmentation
from whid.system import System


def orders_of(model: System) -> Orders:
    """Return zeros and poles of a declared model's linear blocks, those before its first nonlinear block and those after.

    >>> from whid.blocks.dead_zone import DeadZone
    >>> orders_of(System(chain=(Linear(num=(1.0,), den=(1.0, 1.0, 1.0)), DeadZone(low=-1.0, high=1.0))))
    (0, 2, 0, 0)
    """
    linear = [isinstance(block, Linear) for block in model.chain]
    first = linear.index(False) if False in linear else len(linear)
    sides = (model.chain[:first], model.chain[first:])
    counts = []
    for side in sides:
        polynomials = [block.transfer_function() for block in side if isinstance(block, Linear)]
        counts += [sum(len(np.trim_zeros(pair[part], "f")) - 1 for pair in polynomials) for part in (0, 1)]
    return counts[0], counts[1], counts[2], counts[3]


def static_block(curve: StaticCurve, pieces: Segmentation) -> Block:
    """Return f as pieces, or through the levels where pieces do not describe it (χ² rejects them at 1e-3)."""
    if pieces.p >= 1e-3 or len(curve.level) < 3:
        return Piecewise(
            breaks=tuple(map(float, pieces.breaks)),
            pieces=tuple(tuple(map(float, c[: d + 1])) for c, d in zip(pieces.coefficients, pieces.degrees, strict=True)),
        )
    level, mean, *_ = pooled(curve)
    return Table(inputs=tuple(map(float, level)), outputs=tuple(map(float, mean)))


def from_rational(
    fit: Rational, static: StaticPart, pieces: Segmentation, normalisation: str, missing: tuple[str, ...]
) -> Model:
    """Return front, f, back: the linear blocks and the pieces under the sines from the joint fit, the rest as it was."""
    first = int(np.searchsorted(pieces.breaks, static.breaks[0])) if len(static.breaks) else _piece_of(pieces, static)
    renamed = {name: _tree_name(name, first, fit) for name in fit.estimate.names}
    seg = pieces.estimate
    others = [k for k, name in enumerate(seg.names) if f"chain.1.{name}" not in renamed.values()]
    names = tuple(renamed.values()) + tuple(f"chain.1.{seg.names[k]}" for k in others)
    unit = np.array([_unit(name, fit.reference) for name in fit.estimate.names])
    values = np.concatenate([fit.estimate.values * unit, seg.values[others]])
    n = len(renamed)
    covariance = np.zeros((len(names), len(names)))
    covariance[:n, :n] = fit.estimate.covariance * np.outer(unit, unit)
    covariance[n:, n:] = seg.covariance[np.ix_(others, others)]
    std = np.concatenate([fit.estimate.std * unit, seg.std[others]])
    order = fit.estimate._replace(
        names=names, values=values, covariance=covariance, std=std, rank=fit.estimate.rank + len(others)
    )
    blocks: tuple[Block, ...] = (
        Linear(num=tuple(map(float, fit.front_num)), den=tuple(map(float, fit.front_den))),
        _piecewise(pieces, dict(zip(names, values, strict=True))),
        Linear(num=tuple(map(float, fit.back_num)), den=tuple(map(float, fit.back_den))),
    )
    empty = np.zeros((0, len(names)))
    return Model(System(chain=blocks), order._replace(null_directions=empty), normalisation, missing)


def rivals_of(fit: Rational, system: System) -> list[System]:
    """Return the system with the linear blocks of every rival of the joint fit that has no more numbers.

    Those with more were not worth them, and what a record of all samples says of a pole far beyond the sines costs seconds.
    """
    found, own = [], sum(map(len, (fit.front_num, fit.front_den, fit.back_num, fit.back_den)))
    for parts in fit.alternatives():
        if sum(map(len, parts)) > own:
            continue
        front_num, front_den, back_num, back_den = (tuple(map(float, part)) for part in parts)
        front, back = Linear(num=front_num, den=front_den), Linear(num=back_num, den=back_den)
        found.append(System(chain=(front, *system.chain[1:-1], back)))
    return found


def sharings_of(system: System, told: tuple[int, int] | None) -> list[System]:
    """Return the ways to share the roots in front of f between front and back; complex pairs stay together.

    told: the poles of front and back, where they are. Inside one affine piece of f sines tell the product only.

    >>> f = Piecewise(breaks=(0.0,), pieces=((0.0,), (0.0, 1.0)))
    >>> chain = Linear(num=(1.0,), den=(2.0, 3.0, 1.0)), f, Linear(num=(1.0,), den=(1.0,))
    >>> [(front.den, back.den) for front, _, back in (s.chain for s in sharings_of(System(chain=chain), (1, 1)))]
    [((1.0, 1.0), (2.0, 1.0)), ((2.0, 1.0), (1.0, 1.0))]
    """
    front = system.chain[0]
    assert isinstance(front, Linear)
    zeros, poles = (_together(np.asarray(np.roots(part), complex)) for part in (front.num or (1.0,), front.den or (1.0,)))
    found = []
    for behind in product((False, True), repeat=len(zeros) + len(poles)):
        (front_num, back_num), (front_den, back_den) = _shared(zeros, behind), _shared(poles, behind[len(zeros) :])
        proper = len(front_num) <= len(front_den) and len(back_num) <= len(back_den)
        if proper and (told is None or told == (len(front_den) - 1, len(back_den) - 1)):
            blocks = Linear(num=front_num, den=front_den), Linear(num=back_num, den=back_den)
            found.append(System(chain=(blocks[0], *system.chain[1:-1], blocks[1])))
    return found


def _together(roots: Complexes) -> list[Complexes]:
    """Return the real roots and the complex pairs."""
    return [np.array([r, r.conj()]) if r.imag else np.array([r]) for r in roots if r.imag >= 0]


def _shared(groups: Sequence[Complexes], behind: Sequence[bool]) -> list[tuple[float, ...]]:
    """Return the polynomials of the roots in front and of those behind, descending, 1 at s = 0."""
    found = []
    for side in (False, True):
        roots = [group for group, back in zip(groups, behind, strict=False) if back is side]
        polynomial = np.poly(np.concatenate(roots)).real if roots else np.ones(1)
        found.append(tuple(map(float, polynomial / polynomial[-1])))
    return found


def from_lags(
    found: Lags, f: Block, pieces: Segmentation, noise_std: float, normalisation: str, missing: tuple[str, ...]
) -> Model:
    """Return the chosen lag in front of f or behind it, and f as the levels gave it; χ² against the levels' noise."""
    front, e, seg = found.place[found.chosen] == "front", found.estimate, pieces.estimate
    e = e._replace(chi2=e.chi2 / noise_std**2 if noise_std else float("nan"))
    names = tuple(f"chain.{0 if front else 1}.den.{len(e.names) - 1 - k}" for k in range(len(e.names)))
    if isinstance(f, Piecewise):
        both = np.zeros((len(names) + len(seg.names),) * 2)
        both[: len(names), : len(names)], both[len(names) :, len(names) :] = e.covariance, seg.covariance
        e = e._replace(
            values=np.concatenate([e.values, seg.values]), std=np.concatenate([e.std, seg.std]), covariance=both,
            rank=e.rank + len(seg.names), null_directions=np.empty((0, len(both))),
        )  # fmt: skip
        names += tuple(f"chain.{1 if front else 0}.{name}" for name in seg.names)
    lag = found.block()
    return Model(System(chain=(lag, f) if front else (f, lag)), e._replace(names=names), normalisation, missing)


def _piece_of(pieces: Segmentation, static: StaticPart) -> int:
    return int(np.searchsorted(pieces.breaks, np.mean(static.level)))


def _tree_name(name: str, first: int, fit: Rational) -> str:
    """Return the path in the tree: `f.pieces.0.2` → `chain.1.pieces.3.2`, `front.den.1` (of s) → `chain.0.den.<place>`."""
    block, part, *place = name.split(".")
    if block == "f":
        return ".".join(["chain.1", part, str(int(place[0]) + first), *place[1:]])
    coefficients = getattr(fit, f"{block}_{part}")
    return f"chain.{0 if block == 'front' else 2}.{part}.{len(coefficients) - 1 - int(place[0])}"


def _unit(name: str, reference: float) -> float:
    block, _, *place = name.split(".")
    return 1.0 if block == "f" else reference ** -int(place[0])


def _piecewise(pieces: Segmentation, values: dict[str, float]) -> Piecewise:
    def coefficients() -> Iterator[tuple[float, ...]]:
        for p, degree in enumerate(pieces.degrees):
            yield tuple(float(values[f"chain.1.pieces.{p}.{k}"]) for k in range(degree + 1))

    breaks = tuple(float(values[f"chain.1.breaks.{k}"]) for k in range(len(pieces.breaks)))
    return Piecewise(breaks=breaks, pieces=tuple(coefficients()))
