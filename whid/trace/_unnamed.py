"""What no effect of the library does, described: the past that a residual follows, in the currency of the effects.

It is no effect: nothing is added to the model. Where one description does more than all that was named, the names are leads.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from whid.blocks.backlash import Backlash
from whid.blocks.chain import Chain
from whid.blocks.parallel import Parallel
from whid.blocks.polynomial import Polynomial
from whid.effects._candidate import Candidate
from whid.effects._look import Look
from whid.effects._sites import Sites
from whid.signal import Floats
from whid.trace._refit import error2

SHORTEST, LONGEST, LAGS = 10.0, 3000.0, 15  # samples of a time constant, how many are tried
# of the range: plays whose sum is any hysteresis that does not depend on the rate
GAPS = (0.02, 0.05, 0.1, 0.17, 0.28, 0.45)


class Unnamed(NamedTuple):
    """A description in words, and the nats that it gains, its numbers and all that was tried paid."""

    words: str
    gain: float


def unnamed(look: Look) -> Unnamed:
    """Return the description that explains most of what is left, the model's numbers going along, to first order.

    The gain or the zero of the output follows the power of output or input through a lag, e = (a or a·ŷ)·x²/(τs + 1); or
    there is a hysteresis that does not depend on the rate, a sum of plays [Prandtl-Ishlinskii], ahead of a declared block
    or behind all.
    """
    return max((*_followed(look), *_hysteresis(look)), key=lambda d: d.gain)


def _followed(look: Look) -> Iterator[Unnamed]:
    from scipy.signal import lfilter

    dt = look.records[0].dt
    sources = {"output": look.predicted, "input": tuple(np.asarray(r.u, float) for r in look.records)}
    lags = np.geomspace(SHORTEST, LONGEST, LAGS)
    for name, signals in sources.items():
        columns: list[Floats] = []
        for x, y in zip(signals, look.predicted, strict=True):
            pole = np.exp(-1 / lags)
            power = np.stack([lfilter([1 - p], [1, -p], x**2, zi=[p * x[0] ** 2])[0] for p in pole], axis=1)
            columns.append(np.concatenate([power * y[:, None], power], axis=1))
        every = look.rest(look.rows(columns))
        size = np.sum(every**2, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            explained = np.where(size > 0, (every.T @ look.left) ** 2 / size, 0.0)
        tried = 2 * len(every.T)
        for what, share in (("gain", explained[:LAGS]), ("zero", explained[LAGS:])):
            best = int(np.argmax(share))
            gain = _gain(look, look.chi2 - float(share[best]), 2, tried)
            yield Unnamed(f"the {what} follows the past power of the {name}, over about {lags[best] * dt:.3g} s", gain)


def _hysteresis(look: Look) -> Iterator[Unnamed]:
    sites = Sites(look.system, look.core)
    if sites.looped:
        return
    places = [*range(*look.core), look.core[1]]
    for place in places:
        low, high = look.span(place)
        change = look.sampled.along(_plays(sites, place, high - low)) if high > low else None
        if change is None or not np.any(change):
            continue
        left = look.left - change @ np.linalg.lstsq(change, look.left, rcond=1e-6)[0]
        behind = place == look.core[1]
        where = "behind the last block" if behind else f"ahead of block {place + 1} ({sites.blocks[place].kind})"
        yield Unnamed(f"a hysteresis {where}", _gain(look, float(left @ left), len(GAPS), len(places)))


def _plays(sites: Sites, place: int, width: float) -> Candidate:
    """Return the edit that puts a straight path and plays of several gaps beside one another at a place."""
    straight = Polynomial(coefficients=(0.0, 1.0), fix=True)
    scale = Polynomial(coefficients=(0.0, 0.0), fix=("coefficients.0",))
    plays = tuple(Chain(chain=(Backlash(gap=share * width, fix=True), scale)) for share in GAPS)
    edit = sites.inserted(place, Parallel(parallel=(straight, *plays)), inside=True)
    names = tuple(f"parallel.{k}.chain.1.coefficients.1" for k in range(1, len(plays) + 1))
    return edit.candidate(*names, amplitude=names)


def _gain(look: Look, chi2: float, numbers: int, tried: int) -> float:
    n = look.samples
    return float(n / 2 * np.log(error2(look) / max(chi2, 1e-300)) - numbers / 2 * np.log(n) - np.log(tried))
