"""The strongest line of a residual."""

from __future__ import annotations

import numpy as np

from whid.effects._look import Look

FINE = 4  # places tried a line
SLOWEST = 10  # cycles a record: what is slower is a drift


def strongest(look: Look) -> tuple[float | None, int]:
    """Return ω of the highest power in what is left of the only record, rad/s, and how many lines were looked at."""
    if len(look.records) != 1 or look.samples < 100:
        return None, 0
    record, use = look.records[0], look.use[0]
    every = np.zeros(len(record))
    every[use] = look.left
    power = np.abs(np.fft.rfft(every, FINE * len(every))) ** 2
    power[: FINE * SLOWEST] = 0.0
    line = int(np.argmax(power[:-FINE]))
    return 2 * np.pi * line / (FINE * len(every) * record.dt), len(every) // 2
