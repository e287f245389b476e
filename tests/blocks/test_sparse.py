"""Tangents of which only a few are not 0 on each panel: the same through a filter as all of them written out."""

from dataclasses import replace

import numpy as np
import pytest

from whid.blocks._filter import filtered
from whid.blocks.linear import Linear, _realised
from whid.blocks.piecewise import Piecewise
from whid.blocks.table import Table
from whid.signal import Signal, held

X = (-1.5, -0.7, -0.2, 0.4, 0.9, 1.6)
CURVES = {
    "table": Table(inputs=X, outputs=tuple(np.tanh(X))),
    "table held beyond its ends": Table(inputs=X, outputs=tuple(np.tanh(X)), beyond="hold"),
    "pieces with jumps": Piecewise(breaks=(-0.5, 0.6), pieces=((0.6, 0.6), (0.0,), (-0.1, 0.0, 1.0))),
}
FRONT = Linear(num=(1.0,), den=(0.8, 1.4, 1.0))
BACKS = {"one filter": Linear(num=(0.3, 1.0), den=(0.5, 1.0)), "clustered": Linear(zeros=(), poles=(-2.0,) * 7, gain=128.0)}
U = np.repeat(np.random.default_rng(5).normal(size=60) * 1.6, 5)


@pytest.mark.parametrize("back", BACKS.values(), ids=BACKS)
@pytest.mark.parametrize("course", ["zoh", "foh"])
@pytest.mark.parametrize("name", CURVES)
def test_sparse_is_dense(name, course, back):
    curve = CURVES[name]
    v, seeds, _ = FRONT.tangent(held(U, 0.1, course), [], ["den.0", "den.1"])
    names = [p.name for p in curve.parameters()][1:]  # one is held
    stack = curve.tangent(v, seeds, names).tangents.stack
    assert stack.sparse is not None
    written_out = Signal(stack.values, stack.dt, stack.t0, stack.between, stack.order)
    r = _realised(back, 0.1, v.order)
    (a, last), (b, end) = filtered(r, stack), filtered(r, written_out)
    np.testing.assert_allclose(a.values, b.values, atol=1e-13 * np.abs(b.values).max())
    np.testing.assert_allclose(last, end, atol=1e-12 * np.abs(end).max())
    np.testing.assert_allclose(a.panels.values, b.panels.values, atol=1e-12 * np.abs(b.panels.values).max())
    assert np.abs(b.values).max(axis=1).min() > 0  # every number was seen


def test_knees_round_everything_so_that_nothing_is_sparse():
    curve = replace(CURVES["table"], knee=0.1)
    assert curve.few(np.zeros((4, 3)), ["outputs.0", "outputs.1"]) is None
