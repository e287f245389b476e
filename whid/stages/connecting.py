"""Which sines would connect the phases of the two linear blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from whid.signal import Floats

OCTAVES, TRIPLE = (1, 2, 4, 8), (1, 2, 3)


def connecting(omega: Floats, degree: int, highest: float) -> Floats:
    """Return the frequencies that make a chain {1, 2, 4, 8}·ω (a quadratic f) or {1, 2, 3}·ω (degree 3 and more) whole.

    In such a chain every harmonic of one sine but the last ones is a frequency that another sine measures as well, so that
    its phases hang together and one free delay is left. The chain that has most of its sines already is taken, of equal
    ones the highest (the shortest experiment) that stays at or below `highest`, rad/s. Empty where f makes no second
    harmonic. Source [PAPERS A, build 5].

    >>> connecting(np.array([0.02, 0.04, 0.06]), 2, 1.0)
    array([0.08, 0.16])
    >>> connecting(np.array([0.02, 0.04, 0.06]), 3, 1.0)
    array([], dtype=float64)
    """
    if degree < 2 or not len(omega):
        return np.empty(0)
    steps = np.array(OCTAVES if degree == 2 else TRIPLE, float)
    chains = [w / step * steps for w in omega for step in steps if w / step * steps[-1] <= highest * (1 + 1e-9)]
    if not chains:
        return np.empty(0)

    def there(chain: Floats) -> NDArray[np.bool_]:
        return np.asarray(np.any(np.abs(chain[:, None] / omega - 1) < 1e-6, axis=1))

    best = max(chains, key=lambda chain: (int(there(chain).sum()), chain[0]))
    return np.asarray(best[~there(best)])
