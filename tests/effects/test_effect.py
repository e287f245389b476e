"""The interface of an effect, shown by a small one: an offset at the output."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from whid.blocks.chain import Chain
from whid.blocks.constant import Constant
from whid.blocks.linear import Linear
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look, Noise
from whid.effects._sites import Sites
from whid.predict import predict
from whid.record import Record
from whid.system import System
from whid.trace._refit import fitted, refit


@dataclass(frozen=True, kw_only=True)
class Offset(Effect):
    """y = x + offset: a branch beside the last block."""

    places: ClassVar[tuple[Place, ...]] = ("output",)
    place: Place = "output"

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        yield sites.beside(sites.end - 1, Constant(level=0.0)).candidate("level", amplitude=("level",))


def look(offset, seed):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(400)
    blank = Record(u=u, y=u, dt=0.1)
    y = predict(PLANT.tree, blank) + offset + 0.1 * rng.standard_normal(400)
    return fitted(Look(PLANT, (replace(blank, y=y),), (Noise(0.1),), (0, 1)))[0]


PLANT = System(chain=(Linear(num=(1.0,), den=(0.5, 1.0)),))


def test_screening_puts_the_number_where_the_refit_ends():
    before = look(0.05, 1)
    (start,) = Offset().screen(before)
    assert start.gain > 10
    found = refit(before, [start])
    assert abs(found.gain - start.gain) < 1
    path = found.candidate.new[0]
    at = found.estimate.names.index(path)
    assert abs(found.estimate.values[at] - 0.05) < 4 * found.estimate.std[at]
    assert abs(start.candidate.values[path] - found.estimate.values[at]) < found.estimate.std[at]
    assert all(s.gain < 0 for s in Offset().screen(found.look))


def test_silent_on_clean_noise():
    gains = [Offset().screen(look(0.0, seed))[0].gain for seed in range(100, 140)]
    assert max(gains) < 10  # a χ² of one degree beyond 2·(10 + 3): 3e-7


def test_edits_of_a_system():
    lag, gain = Linear(num=(1.0,), den=(1.0, 1.0)), Linear(num=(3.0,), den=(1.0,))
    assert PLANT.inserted(0, gain).chain == (gain, *PLANT.chain)
    assert PLANT.inserted(1, gain).chain == (*PLANT.chain, gain)
    assert PLANT.replaced(0, Chain(chain=(lag, gain))).chain == (Chain(chain=(lag, gain)),)
    u = np.random.default_rng(0).standard_normal(50)
    assert np.allclose(PLANT.beside(gain).tree(u, 0.1), PLANT.tree(u, 0.1) + 3 * u)
    twice = Sites(Sites(PLANT, (0, 1)).beside(0, gain).system, (0, 1)).beside(0, gain)
    assert twice.path == "chain.0.parallel.2."
    assert np.allclose(twice.system.tree(u, 0.1), PLANT.tree(u, 0.1) + 6 * u)
