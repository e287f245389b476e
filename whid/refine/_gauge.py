"""A fit without the directions that its data cannot tell: one number is held for each, and said in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whid.blocks._block import Block
from whid.errors import WhidError
from whid.fit import Triangle
from whid.refine._free import FreeNumbers
from whid.refine._problem import Data, Problem
from whid.refine._words import common_factor, dependent, in_words, last_to_hold
from whid.signal import Floats


def gauged(free: FreeNumbers, data: tuple[Data, ...], path: str, rates: str = "") -> tuple[Problem, tuple[str, ...]]:
    """Return the problem without directions that have no effect, and what was held for them."""
    problem = Problem(free, data, path, rates)
    names = [p.name for p in problem.parameters]
    triangle = started(problem)
    found = [(names[j], d) for j, d in dependent(triangle, last_to_hold(free.tree, names)) if names[j] in set(free.names)]
    if not found:
        return problem, ()
    words = tuple(f"{said(free.tree, names, triangle, name, direction)}: {name} is held" for name, direction in found)
    held = (*free.held, *(name for name, _ in found))
    fewer = Problem(replace(free, held=held), data, path, rates)
    keep = np.array([name not in held for name in names])
    fewer.latest[fewer.start.tobytes()] = triangle.columns(keep)
    return fewer, words


def started(problem: Problem) -> Triangle:
    """Return the linearisation at the start; raise `WhidError("fit-start")` where there is none."""
    with np.errstate(all="ignore"):
        triangle = problem.linearise(problem.start)
        size = triangle.chi2 + float(np.sum(triangle.r**2))
    if not np.isfinite(size):
        raise WhidError("fit-start", "the model's output is not finite at the start values")
    return triangle


def said(tree: Block, names: list[str], triangle: Triangle, name: str, direction: Floats) -> str:
    """Return a direction in words: the common factor of one linear block where that is what it is."""
    own = common_factor(tree, names, name) if ".den." in name else None
    if own is not None:
        size = np.linalg.norm(triangle.r, axis=0) @ np.abs(own)
        direction = own if np.linalg.norm(triangle.r @ own) < 1e-6 * size else direction
    return in_words(tree, names, direction)
