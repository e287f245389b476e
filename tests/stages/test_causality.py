"""Which column moves first: size of the test on unrelated noise, power on plants, silence on periodic data."""

import numpy as np
import pytest

from whid.blocks.linear import Linear
from whid.stages.causality import causality


def test_unrelated_columns_cannot_tell():
    verdicts = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        verdicts.append(causality(rng.standard_normal(500), rng.standard_normal(500)).verdict)
    assert set(verdicts) == {"cannot tell"}


@pytest.mark.parametrize(("hold", "least"), [(1, 20), (5, 10), (40, 0)])
def test_never_wrong_and_sure_where_the_input_is_rich(hold, least):
    """Rare steps on a slow noisy plant leave it in doubt; `files/checks.py` then goes by looks."""
    right = swapped = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(-1, 1, 4000 // hold), hold)
        y = Linear(num=(1.0,), den=(4.0, 2.0, 1.0))(u, 0.5) + 0.02 * rng.standard_normal(len(u))
        verdicts = causality(u, y).verdict, causality(y, u).verdict
        assert verdicts in (("as declared", "swapped"), ("cannot tell", "cannot tell"))
        right += verdicts[0] == "as declared"
        swapped += verdicts[1] == "swapped"
    print(f"hold {hold}: right {right}/20, swapped found {swapped}/20")
    assert min(right, swapped) >= least


def test_a_sine_has_no_arrow_of_time():
    n = np.arange(3000)
    u, y = np.cos(2 * np.pi * n / 50), np.cos(2 * np.pi * n / 50 - 1)
    assert causality(u, y).verdict == causality(y, u).verdict == "cannot tell"
