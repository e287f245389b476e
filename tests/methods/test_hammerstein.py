"""Hammerstein as the special case: h is the static curve itself, G comes from sines on its pieces."""

from dataclasses import replace

import numpy as np
import pytest

from tests.brouri2014 import F1, G1, G2, H1, H2, START
from whid.blocks.linear import Linear
from whid.disturbances.ar import Ar
from whid.disturbances.white import White
from whid.methods._method import Model, Wanted
from whid.methods._pieces_model import held_names
from whid.methods.hammerstein import Hammerstein
from whid.refine import bound
from whid.simulate import simulate
from whid.system import System

UNIT = (Linear(num=(1.0,), den=(0.5, 0.8, 1.0)), *G2[1:])


def found(chain, noise, seed):
    """The Model of a simulated plant that answers, and all records."""
    system, rng = System(chain=chain, noise=(noise,)), np.random.default_rng(seed)
    records = [simulate(system, START, rng)]
    running, answer, model = Hammerstein()(records), None, None
    try:
        while True:
            got, answer = running.send(answer), None
            if isinstance(got, Wanted):
                answer = simulate(system, replace(START, parts=got.plan), rng)
                records.append(answer)
            elif isinstance(got, Model):
                model = got
    except StopIteration:
        return model, records


@pytest.mark.parametrize(("h", "g", "jumps"), [(H1, G1, False), (H2, UNIT, True)], ids=["kinks", "jumps and a delay"])
def test_at_the_bound(h, g, jumps):
    model, records = found((h, *g), White(std=0.05), 11)
    truth = System(chain=(h, *g))
    assert [block.kind for block in model.system.chain] == [block.kind for block in truth.chain]
    assert (~model.system.chain[0].kinks()).tolist() == [jumps] * 5
    held = held_names(truth, 3) + (tuple(f"chain.0.breaks.{k}" for k in range(5)) if jumps else ())
    least = bound(truth, records, [0.05] * len(records), fixed=held)
    true = {p.name: p.value for p in truth.tree.parameters(held=True)}
    z = {n: (model.estimate.value(n) - true[n]) / s for n, s in zip(least.names, least.std, strict=True)}
    assert len(z) > 10
    assert max(abs(v) for v in z.values()) < 4.5, z
    assert np.abs(np.array(model.system.chain[0].breaks) - h.breaks).max() < 0.01


def test_coloured_noise_widens_the_errors():
    """AR(.9): its long-run variance is 19 times that of white noise, (1 − .81)/(1 − .9)², errors up to 4.4 times."""
    white, _ = found((H1, *G1), White(std=0.05), 12)
    coloured, _ = found((H1, *G1), Ar(coefficients=(0.9,), std=0.05), 12)
    ratio = coloured.estimate.std[coloured.estimate.names.index("chain.0.pieces.2.0")]
    ratio /= white.estimate.std[white.estimate.names.index("chain.0.pieces.2.0")]
    assert 2.5 < ratio < 6
    z = (coloured.estimate.value("chain.1.den.2") - 1.3) / coloured.estimate.std[
        coloured.estimate.names.index("chain.1.den.2")
    ]
    assert abs(z) < 4.5


def test_an_output_nonlinearity_is_not_hidden_by_more_pieces():
    """A curved f looks like many short pieces to the levels; the sines are not explained by them, and it says so."""
    model, _ = found((H1, *G1, F1), White(std=0.05), 13)
    assert any("more than this structure" in said for said in model.missing)
