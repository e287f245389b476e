"""The moment at which something steps: all moments scored at once, by running sums."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whid.effects._look import Look
from whid.signal import Floats

EDGE = 20  # samples at either end of the record that cannot be told from a step


def switched(look: Look, course: Sequence[Floats]) -> float | None:
    """Return the time t* for which course(t)·[t ≥ t*] explains most of what is left, None where nothing would.

    gain(t*) = ⟨left, c⟩²/‖c − Q(Qᵀc)‖², c the course from t* on; the sums run backwards in time. One record only.
    """
    if len(look.records) != 1 or look.samples < 4 * EDGE:
        return None
    c = look.rows([course[0][:, None]])[:, 0]
    along = np.cumsum((look.left * c)[::-1])[::-1]
    inside = np.cumsum((look.basis * c[:, None])[::-1], axis=0)[::-1]
    size = np.cumsum((c**2)[::-1])[::-1] - np.sum(inside**2, axis=1)
    good = size > 1e-6 * size.max(initial=0.0)
    score = np.where(good, along**2 / np.where(good, size, 1.0), 0.0)
    score[:EDGE] = score[-EDGE:] = 0.0
    best = int(np.argmax(score))
    return float(look.records[0].time[look.use[0]][best]) if score[best] > 0 else None
