"""The residual pulled back through the model, against changes of the input that are simulated."""

from dataclasses import replace

import numpy as np
import pytest

from tests.trace_plants import DT, PLANT, STD
from whid.blocks.backlash import Backlash
from whid.effects._look import Look, Noise
from whid.effects._pulled import pulled
from whid.predict import predict
from whid.record import Record
from whid.system import System


def look(system, *, ar=()):
    rng = np.random.default_rng(8)
    u = np.repeat(rng.uniform(-1, 1, 60), 15)
    blank = Record(u=u, y=u, dt=DT, initial="steady")
    y = predict(system.tree, blank) + STD * rng.standard_normal(len(u))
    return Look(system, (replace(blank, y=y),), (Noise(STD, ar),), (0, len(system.series)))


@pytest.mark.parametrize("ar", [(), (0.6,)])
def test_it_foretells_what_a_small_change_of_the_input_explains(ar):
    here = look(PLANT, ar=ar)
    record, pull = here.records[0], pulled(here)[0]
    small = 1e-5 * pull / np.abs(pull).max()  # the change that explains most for its size
    changed, plain = (predict(PLANT.tree, replace(record, u=record.u + k * small), "sampled") for k in (1, -1))
    change = here.rows([((changed - plain) / 2)[:, None]])[:, 0]
    assert float(pull @ small) == pytest.approx(float(here.left @ change), rel=0.02)


def test_a_play_has_no_slope_to_pull_through():
    assert pulled(look(System(chain=(*PLANT.chain, Backlash(gap=0.1)), noise=PLANT.noise))) is None
