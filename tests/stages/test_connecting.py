"""Frequencies that connect phases: the chain that is made whole has one free delay, by the rank of the phase system."""

import numpy as np
import pytest

from whid.stages.connecting import connecting
from whid.stages.identifiability import identifiability


@pytest.mark.parametrize(
    ("degree", "omega", "chain"),
    [
        (2, [0.02, 0.04, 0.06], [0.02, 0.04, 0.08, 0.16]),
        (2, [0.3], [0.3, 0.6, 1.2, 2.4]),
        (3, [0.1, 0.2], [0.1, 0.2, 0.3]),
    ],
)
def test_a_chain_that_is_whole_leaves_one_free_delay(degree, omega, chain):
    more = connecting(np.array(omega), degree, 2.5)
    np.testing.assert_allclose(more, [w for w in chain if w not in omega])
    report = identifiability(np.array(chain), [range(1, degree + 1)] * len(chain))
    assert (report.nullity, len(report.groups)) == (1, 1)


def test_no_frequency_beyond_the_highest_and_none_for_an_affine_f():
    assert connecting(np.array([0.02]), 1, 1.0).size == 0
    assert connecting(np.array([0.5]), 2, 0.6).max() <= 0.6
    assert connecting(np.array([0.5]), 2, 0.01).size == 0
