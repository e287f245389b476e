"""Algebraic loops: one equation e = u + sign·back(forward(e)), solved for one sample or, without memory, for all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from whid.blocks._block import Block
from whid.blocks._split import pointwise, split
from whid.blocks._static import Static
from whid.blocks.chain import Chain
from whid.blocks.parallel import Parallel
from whid.errors import WhidError
from whid.signal import Floats, Panels, Signal


class StaticLoop(NamedTuple):
    """A loop of blocks without memory."""

    forward: Block
    back: Block | None
    sign: Literal[-1, 1]

    def around(self, e: Floats) -> tuple[Floats, Floats]:
        """Return sign·z and its derivative for every e."""
        z, (slope,), _ = self.open.tangent(Signal(e, 1.0), [Signal(np.ones(len(e)), 1.0)], ())
        return self.sign * z.values, self.sign * slope.values

    @property
    def open(self) -> Block:
        """Return the open loop."""
        return self.forward if self.back is None else Chain(chain=(self.forward, self.back))


def memoryless(block: Block) -> bool:
    """Tell whether a block is made of static blocks only."""
    if isinstance(block, (Chain, Parallel)):
        return all(memoryless(child) for child in block.children())
    return isinstance(block, Static)


def error(loop: StaticLoop, u: Signal) -> Signal:
    """Return e wherever u is known, on panels split where the closed loop has a kink."""
    values = _solved(loop, u.values)
    if not callable(u.between):
        return u.with_values(values)

    def between() -> Panels:
        nodes = np.concatenate([u.panels.values.ravel(), u.panels.splits.values.ravel()])
        panels, _ = split(u, _kinks(loop, nodes))
        s = panels.splits
        dense = _solved(loop, panels.values)
        return Panels(dense, s._replace(values=_solved(loop, s.values)) if len(s.interval) else s)

    return u.with_values(values, between)


def static_tangent(loop: StaticLoop, u: Signal, seeds: Sequence[Signal], wrt: Sequence[str]) -> tuple[Signal, list[Signal]]:
    """Return y and dy = m·forward′·(du + sign·∂back) + m·∂forward with m = 1/(1 − sign·back′·forward′)."""
    sign, e = loop.sign, error(loop, u)
    one = pointwise(np.ones_like, [e])
    y, (rate, *own), _ = loop.forward.tangent(e, [one], [n[8:] for n in wrt if n.startswith("forward.")])
    open_, behind = rate, list[Signal]()
    if loop.back is not None:
        _, (open_, *behind), _ = loop.back.tangent(y, [rate], [n[5:] for n in wrt if n.startswith("back.")])
    along = [pointwise(lambda f, g, d: f * d / (1 - sign * g), [rate, open_, seed]) for seed in seeds]
    ahead = iter([pointwise(lambda g, d: d / (1 - sign * g), [open_, d]) for d in own])
    after = iter([pointwise(lambda f, g, d: sign * f * d / (1 - sign * g), [rate, open_, d]) for d in behind])
    return y, along + [next(ahead if n.startswith("forward.") else after) for n in wrt]


def _kinks(loop: StaticLoop, u: Floats) -> Floats:
    """Return the u at which some block of the loop is at a breakpoint: there u = e − sign·z(e) is known from e."""
    e = _solved(loop, np.array([u.min(initial=0.0), u.max(initial=0.0)]))
    margin = 0.5 * np.ptp(e) + 1e-9
    grid = np.linspace(e.min() - margin, e.max() + margin, 401)
    found = [x for before, block in _statics(loop.open) for b in block.breakpoints() for x in _preimages(before, b, grid)]
    at = np.array(found, float)
    return np.unique(at - loop.around(at)[0]) if len(at) else at


def _statics(block: Block, before: tuple[Block, ...] = ()) -> Iterator[tuple[tuple[Block, ...], Static]]:
    """Yield every static block of a tree and the blocks that its input has gone through."""
    if isinstance(block, Static):
        yield before, block
    elif isinstance(block, Chain):
        for k, child in enumerate(block.chain):
            yield from _statics(child, (*before, *block.chain[:k]))
    else:
        for child in block.children():
            yield from _statics(child, before)


def _preimages(before: tuple[Block, ...], b: float, grid: Floats) -> list[float]:
    """Return the e at which what comes out of some blocks is b."""
    from scipy.optimize import brentq

    if not before:
        return [float(b)]
    tree = Chain(chain=before)
    side = tree(grid, 1.0, "discrete") >= b
    cells = np.flatnonzero(side[1:] != side[:-1])
    return [
        float(brentq(lambda e: float(tree(np.array([e]), 1.0, "discrete")[0]) - b, grid[k], grid[k + 1], xtol=1e-15))
        for k in cells
    ]


def _solved(loop: StaticLoop, u: Floats) -> Floats:
    """Solve e = u + sign·z(e) for every u, any shape: damped Newton, and one by one where that fails."""
    flat = np.array(u, float).ravel()
    with np.errstate(all="ignore"):
        e, r = _newton(loop, flat)
    for n in np.flatnonzero(~(np.abs(r) <= 1e-12 * (np.abs(flat) + np.abs(e)))):
        e[n] = _solved_alone(loop, float(flat[n]), float(e[n]))
    return e.reshape(u.shape)


def _newton(loop: StaticLoop, u: Floats) -> tuple[Floats, Floats]:
    """Return e and the residual u + sign·z(e) − e that is left; a step that does not shrink it is cut."""
    e, (z, slope) = u.copy(), loop.around(u)
    r = z
    for _ in range(50):
        if not np.any(np.abs(r) > 1e-15 * (np.abs(u) + np.abs(z))):
            break
        step = r / (1 - slope)
        for _ in range(6):
            trial = e + step
            z_trial, slope_trial = loop.around(trial)
            r_trial = u + z_trial - trial
            worse = ~(np.abs(r_trial) < np.abs(r))
            if not worse.any():
                break
            step = np.where(worse, step / 4, step)
        better = np.abs(r_trial) < np.abs(r)
        if not better.any():
            break
        e, z = np.where(better, trial, e), np.where(better, z_trial, z)
        r, slope = np.where(better, r_trial, r), np.where(better, slope_trial, slope)
    return e, r


def _solved_alone(loop: StaticLoop, u: float, guess: float) -> float:
    return root(lambda e: u + float(loop.around(np.array([e]))[0][0]) - e, guess, f"at u = {u:g}")


def root(residual: Callable[[float], float], guess: float, where: str) -> float:
    """Solve residual(e) = 0: secant from the guess, and where that fails a bracket and Brent's method.

    Raises `WhidError("feedback-no-solution")`.
    """
    with np.errstate(all="ignore"):
        e = _secant(residual, guess)
        return _bracketed(residual, guess, where) if e is None else e


def _secant(residual: Callable[[float], float], guess: float) -> float | None:
    def small(r: float, e: float) -> bool:
        return abs(r) <= 1e-13 * (abs(e) + abs(guess)) + 1e-300

    e, r = guess, residual(guess)
    if small(r, e):
        return e
    following = e + r
    for _ in range(20):
        r_next = residual(following)
        if small(r_next, following):
            return following
        if r_next == r or not np.isfinite(r_next):
            break
        e, r, following = following, r_next, following - r_next * (following - e) / (r_next - r)
    return None


def _bracketed(residual: Callable[[float], float], guess: float, where: str) -> float:
    from scipy.optimize import brentq

    r, width = residual(guess), abs(guess) + 1.0
    for reach in width * 2.0 ** np.arange(-20, 40):
        for far in (guess - reach, guess + reach):
            if residual(far) * r < 0:
                e = float(brentq(residual, guess, far, xtol=1e-16 * width, rtol=1e-15, maxiter=500))
                if abs(residual(e)) <= 1e-9 * (abs(e) + width):
                    return e
                raise WhidError("feedback-no-solution", f"the loop's residual jumps over zero at e = {e:g}", where)
    raise WhidError("feedback-no-solution", "no value of e balances the loop", where)
