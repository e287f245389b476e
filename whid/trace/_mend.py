"""A fit that stopped at a wrong place: what slopes do not lead to is searched."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from whid.blocks._static import Static
from whid.effects._candidate import Candidate
from whid.effects._look import Look
from whid.effects._sites import Sites, instant
from whid.errors import WhidError
from whid.fit import Estimate
from whid.signal import Floats
from whid.system import System
from whid.trace._refit import Refit, error2, fitted, gain_over, polished
from whid.trace._selection import Bools

ASIDE = 0.05  # of the range of v: how far off a breakpoint may be
BORDERS = ("breaks", "low", "high", "inputs", "at")
WRONG = 4.0  # robust standard deviations: such a sample may lie on the wrong side of a jump
BESIDE = np.ones(5)  # the samples next to it may, too
TURNS = 4  # of search and fit
FEW = 0.2  # of the samples: more are not crossings
DRAWS = 100  # of each width
WIDTHS = (1.0, 0.5, 0.25, 0.1)  # standard errors


def searched(look: Look) -> Look | None:
    """Return the look with its breakpoints searched without derivatives, all other numbers absorbing what they can."""
    borders, sites = _borders(look), Sites(look.system, look.core)
    if not borders or sites.looped:
        return None
    low, high = look.span((sites.nonlinear or [0])[0])
    reach = tuple((name, ASIDE * (high - low)) for name in borders)
    return look.moved(polished(look, Candidate(look.system, look.core, tuple(borders), (), reach)).system)


def across(look: Look) -> Look | None:
    """Return the look fitted across its jumps, None where no jump reaches the output as it is.

    A jump that nothing smooths puts a sample on one side or the other: the error is a stair over every number that decides
    when the jump is met, without a slope towards the right step. So samples that may lie on the wrong side leave the fit,
    one turn after another; then numbers are drawn as that fit leaves them uncertain, and judged on all samples.
    """
    if not _bare_jump(look):
        return None
    every, aside = look.records, tuple(np.zeros(len(r), bool) for r in look.records)
    for _ in range(TURNS):
        look = searched(look) or look
        aside = tuple(a | _doubtful(e) for a, e in zip(aside, look.errors, strict=True))
        if sum(a.sum() for a in aside) > FEW * look.samples:
            return None
        kept = tuple(replace(r, valid=r.mask & ~a) for r, a in zip(every, aside, strict=True))
        look, estimate = fitted(replace(look, records=kept, _courses={}))
        look = replace(look, records=every, _courses={})
    return _drawn(look, estimate)


def _drawn(look: Look, estimate: Estimate) -> Look:
    """Return the best look among draws from an estimate's normal distribution, ever narrower ones about the best so far."""
    rng = np.random.default_rng(DRAWS)
    names, centre, best = estimate.names, estimate.values, error2(look)
    for width in WIDTHS:
        scatter = rng.multivariate_normal(np.zeros(len(names)), width**2 * estimate.covariance, DRAWS)
        for values in centre + scatter:
            there = look.moved(at(look.system, dict(zip(names, values.tolist(), strict=True))))
            if (cost := error2(there)) < best:
                look, best, centre = there, cost, values
    return look


def at(system: System, values: Mapping[str, float]) -> System:
    """Return the system with other values of some numbers."""
    return replace(system, chain=system.tree.with_parameters(dict(values)).chain)


def mended(before: Look, found: Refit) -> Refit:
    """Return a refit with the breakpoints searched, where that finds a better place: what was missing had moved them."""
    if found.told is not None:
        return found
    for start in (searched, across):
        better = tried(start, found.look)
        if better is None:
            continue
        after, estimate = better
        chi2, reached = error2(after), found.candidate._replace(system=after.system)
        if chi2 < found.chi2:
            gain = gain_over(before, chi2, reached)
            found = found._replace(candidate=reached, look=after, estimate=estimate, chi2=chi2, gain=gain)
    return found


def tried(start: Callable[[Look], Look | None], look: Look) -> tuple[Look, Estimate] | None:
    """Return a fit from where a search leads, None where it leads nowhere."""
    try:
        found = start(look)
        return None if found is None else fitted(found)
    except (WhidError, ValueError, np.linalg.LinAlgError):
        return None


def _bare_jump(look: Look) -> bool:
    """Tell whether there is a curve with jumps behind which nothing has a memory."""
    blocks, noise = look.system.series, min(n.std for n in look.noises)
    return any(
        isinstance(block, Static) and np.any(np.abs(block.jumps()) > noise) and all(map(instant, blocks[place:]))
        for place, block in enumerate(blocks)
    )


def jumps(look: Look) -> bool:
    """Tell whether a curve of the model jumps: no slope leads a fit to where."""
    return any(isinstance(block, Static) and np.any(block.jumps()) for block in look.system.series)


def _doubtful(error: Floats) -> Bools:
    """Return where an error stands out, and the samples beside."""
    size = np.abs(np.nan_to_num(error))
    scale = float(np.median(size[np.isfinite(error)])) / 0.6745
    return np.asarray(np.convolve(size > WRONG * scale, BESIDE, "same") > 0)


def _borders(look: Look) -> list[str]:
    return [p.name for p in look.system.tree.parameters() if _head(p.name) in BORDERS]


def _head(name: str) -> str:
    """Return the field that a number belongs to: `breaks` of chain.1.breaks.0."""
    parts = name.split(".")
    return parts[-2] if parts[-1].isdecimal() else parts[-1]
