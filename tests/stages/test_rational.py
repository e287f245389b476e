"""What the joint rational fit refuses."""

import numpy as np

from whid.stages.rational import _stable


def test_a_pole_at_infinity_is_no_pole():
    assert _stable(np.empty(0))
    assert _stable(np.array([0.5]))
    assert not _stable(np.array([0.0]))
    assert not _stable(np.array([4.0, 2.0, 0.0]))
    assert not _stable(np.array([-0.5]))
