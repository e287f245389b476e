"""Directions in which a model may change without its output changing: found by rank, held, and said in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from whid.blocks._block import Block
from whid.blocks._static import Static
from whid.blocks.linear import Linear
from whid.fit import Triangle
from whid.refine._free import walk
from whid.signal import Floats

DEPENDENT = 1e-7  # what is left of a unit column that the columns before it explain: tangents are good to 1e-10


def dependent(triangle: Triangle, last: NDArray[np.bool_]) -> list[tuple[int, Floats]]:
    """Return (column, direction) of every column that the others explain; columns in `last` are the first to go.

    The direction (p,) changes the column by 1 and others such that no output changes; what has no part in it is 0. A column
    of zeros is not among them.
    """
    size = np.linalg.norm(triangle.r, axis=0)
    scaled = triangle.r / np.where(size > 0, size, 1.0)
    kept: list[int] = []
    found = []
    basis = np.zeros((len(scaled), 0))
    for j in sorted(np.flatnonzero(size > 0), key=lambda j: (last[j], j)):
        left = scaled[:, j] - basis @ (basis.T @ scaled[:, j])
        left -= basis @ (basis.T @ left)
        if np.linalg.norm(left) > DEPENDENT:
            basis = np.column_stack([basis, left / np.linalg.norm(left)])
            kept.append(int(j))
            continue
        direction = np.zeros(len(size))
        direction[kept] = -np.linalg.lstsq(scaled[:, kept], scaled[:, j], rcond=None)[0] / size[kept]
        direction[j] = 1 / size[j]
        direction[np.abs(direction) * size < 1e-5 * np.abs(direction * size).max()] = 0.0
        found.append((int(j), direction / direction[j]))
    return found


def last_to_hold(tree: Block, names: Sequence[str]) -> NDArray[np.bool_]:
    """Tell which numbers may stand for a gauge: the constant terms and gains of linear blocks."""
    candidates = set()
    for path, block in walk(tree):
        if isinstance(block, Linear) and block.num is not None and block.den is not None:
            candidates |= {f"{path}num.{len(block.num) - 1}", f"{path}den.{len(block.den) - 1}"}
        elif isinstance(block, Linear):
            candidates.add(f"{path}gain")
    return np.array([name in candidates for name in names])


def common_factor(tree: Block, names: Sequence[str], held: str) -> Floats | None:
    """Return the direction that scales num and den of the linear block with this number, None for any other number."""
    for path, block in walk(tree):
        if isinstance(block, Linear) and block.num is not None and block.den is not None and held.startswith(path):
            values = {f"{path}{p.name}": p.value for p in block.parameters(held=True)}
            if held in values and values[held] and set(values) <= set(names):
                return np.array([values.get(name, 0.0) for name in names]) / values[held]
    return None


def in_words(tree: Block, names: Sequence[str], direction: Floats) -> str:
    """Return what a direction means, such as "gain may move between … and …" or "delay may sit in either block".

    >>> from whid.blocks.chain import Chain
    >>> from whid.blocks.polynomial import Polynomial
    >>> two = Chain(chain=(Linear(num=(2.0,), den=(1.0, 1.0)), Polynomial(coefficients=(0.0, 3.0))))
    >>> in_words(two, ["chain.0.num.0", "chain.1.coefficients.1"], np.array([2.0, -3.0]))
    'gain may move between chain.0 (linear) and chain.1 (polynomial)'
    """
    seen = {name: d for name, d in zip(names, direction, strict=True) if d != 0}
    blocks = [(path, block) for path, block in walk(tree) if path and any(_own(block, path, n) for n in seen)]
    changed = {
        f"{path.rstrip('.')} ({block.kind})": _change(
            block, {n[len(path) :]: d for n, d in seen.items() if n.startswith(path)}
        )
        for path, block in blocks
    }
    moved = {name: what for name, what in changed.items() if what}
    kinds = set(moved.values())
    if len(changed) == 1 and not moved:
        path, block = blocks[0]
        values = {path + p.name: p.value for p in block.parameters(held=True)}
        shares = [d / values[n] if values[n] else np.inf for n, d in seen.items()]
        if np.ptp(shares) <= 1e-3 * np.abs(shares).max():
            return f"num and den of {next(iter(changed))} may be scaled together, only their ratio counts"
        return f"numerator and denominator of {next(iter(changed))} have a common factor"
    if kinds == {"gain"}:
        return f"gain may move between {' and '.join(moved)}"
    if kinds == {"delay"}:
        return f"delay may sit in either block: {' or '.join(moved)}"
    if kinds == {"offset"}:
        return f"an offset may move between {' and '.join(moved)}"
    return f"these numbers cannot be told apart: {', '.join(seen)}"


def _own(block: Block, path: str, name: str) -> bool:
    rest = name.removeprefix(path)
    return name.startswith(path) and rest.partition(".")[0] not in {p.partition(".")[0] for p, _ in block.named_children()}


def _change(block: Block, direction: dict[str, float]) -> str:
    """Return what a direction does to one block: nothing, its gain, its delay, an offset, or its dynamics."""
    values = {p.name: p.value for p in block.parameters(held=True)}
    if block.kind == "delay":
        return "delay"
    step = 1e-6 / max(abs(d) / max(abs(values[n]), 1e-9) for n, d in direction.items())
    up, down = (block.with_parameters({n: values[n] + s * step * d for n, d in direction.items()}) for s in (1, -1))
    if isinstance(block, Linear) and isinstance(up, Linear) and isinstance(down, Linear):
        poles = np.abs(np.roots(block.transfer_function()[1]))
        scale = float(poles[poles > 0].min(initial=np.inf)) if block.dt is None else 0.3 / block.dt
        omega = (scale if np.isfinite(scale) else 1.0) * np.array([0.2, 0.5, 1.0, 2.0])
        ratio = np.log(up.gain_at(omega) / down.gain_at(omega)) / 2e-6
        if np.abs(ratio).max() < 1e-4:
            return ""
        if np.ptp(ratio.real) + np.abs(ratio.imag).max() < 1e-3 * np.abs(ratio).max():
            return "gain"
        slope = ratio.imag / omega
        if np.abs(ratio.real).max() + np.ptp(slope) * omega.max() < 1e-3 * np.abs(ratio).max():
            return "delay"
        return "dynamics"
    if isinstance(block, Static) and isinstance(up, Static) and isinstance(down, Static):
        v = np.linspace(-1.0, 1.0, 7) * (1 + np.abs(block.breakpoints()).max(initial=1.0))
        rise = up.value(v) - down.value(v)
        return "offset" if np.ptp(rise) <= 1e-6 * np.abs(rise).max() else "gain"
    return "dynamics"
