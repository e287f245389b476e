"""How much of a residual any small change of the input would explain: the residual pulled back through the model."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from whid.blocks._block import Block
from whid.effects._look import Look
from whid.effects._sites import Sites, instant
from whid.signal import Floats

SMALL = 1e-4  # of the range of a signal: the difference that tells a slope


def pulled(look: Look) -> tuple[Floats, ...] | None:
    """Return g of every record: a small change δ of its input changes ŷ so that ⟨left, change of ŷ⟩ = Σ g·δ, to first order.

    The adjoint of the model's derivative on samples: backwards in time through linear blocks, by the slope through curves.
    None where a block is neither: a loop, a play. Colour is undone as if no sample were missing.
    """
    sites, every = Sites(look.system, look.core), look.sampled
    if look.system.series_path != "chain." or not all(instant(b) or b.kind in ("linear", "delay") for b in sites.blocks):
        return None
    slopes = {k: [slope(b, v) for v in every.signal(k)] for k, b in enumerate(sites.blocks) if instant(b)}
    found, start = [], 0
    for r, (record, use, noise) in enumerate(zip(look.records, look.use, look.noises, strict=True)):
        size = noise.std if noise.shape is None else noise.std * noise.shape[use]
        g = np.zeros(len(record))
        g[use] = look.left[start : start + int(use.sum())] / size
        start += int(use.sum())
        g = lfilter([1.0, *(-a for a in noise.ar)], [1.0], g[::-1])[::-1]
        for k in reversed(range(len(sites.blocks))):
            g = g * slopes[k][r] if k in slopes else sites.blocks[k](g[::-1].copy(), record.dt, "zoh")[::-1]
        found.append(g)
    return tuple(found)


def slope(block: Block, v: Floats) -> Floats:
    """Return f′(v) of a block without memory by a difference: blocks beside one another have no derivative of their own."""
    h = SMALL * (np.ptp(v) or 1.0)
    return np.asarray((block(v + h, 1.0, "discrete") - block(v - h, 1.0, "discrete")) / (2 * h))
