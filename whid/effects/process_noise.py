"""Noise ahead of the curve."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whid.blocks.chain import Chain
from whid.blocks.linear import Linear
from whid.disturbances.process import Process
from whid.effects._effect import Place
from whid.effects._filtered import through
from whid.effects._look import Look
from whid.effects._noisy import Fitted, NoiseEffect, Variances, shaped, stacked, stacked_errors, variances
from whid.effects._pulled import slope
from whid.effects._sites import Sites
from whid.signal import Floats

LIKELY = 3.0  # nats by block, below which a closer look would not reach what is needed
BLOCK = 64  # samples over which the slope of the curve is averaged, and whose spectrum is taken


@dataclass(frozen=True, kw_only=True)
class ProcessNoise(NoiseEffect):
    """Noise that goes through the curve and what is behind it: e = back(f′(v)·w) + white.

    Its signature is a scatter that is large where the curve is steep, coloured by the blocks behind it.
    """

    places: ClassVar[tuple[Place, ...]] = ("noise",)

    def explain(self, look: Look, sites: Sites) -> Fitted | None:
        """Return the size of w that makes the residual likeliest, block by block in frequency, then sample by sample."""
        coloured = any(len(noise.ar) for noise in look.noises)  # a declared colour cannot be told from that of the back
        if not sites.static or coloured or any(noise.kind == "process" for noise in look.system.noise):
            return None
        if sites.system.series_path != "chain.":  # blocks at a multiple of the record's rate: its noise has no place there
            return None
        place = sites.static[0]
        behind = sites.blocks[place + 1 : sites.core[1]]
        slopes = tuple(slope(sites.blocks[place], v) for v in look.signal(place))
        if any(not isinstance(block, Linear) for block in behind):
            return None
        if not behind:
            f = tuple(s**2 for s in slopes)
            found = variances(stacked_errors(look), stacked(look, f, 2))
            noises = shaped(look, found.base, found.share, f)
        else:
            pairs = list(_blocks(look, slopes, Chain(chain=behind)))
            if not pairs:
                return None
            found = variances(np.concatenate([e for e, _ in pairs]), np.concatenate([f for _, f in pairs]))
            noises = look.noises
            one = behind[0] if len(behind) == 1 and len(look.records) == 1 else None
            if found.nats > LIKELY and isinstance(one, Linear) and one.dt is None and not one.state_space().d:
                found = _exact(look, slopes[0], one, found)
        std = float(np.sqrt(found.share))
        return Fitted(Process(std=std), found.nats, {"std": std}, {"std": found.share_std / (2 * std)}, noises)


def _exact(look: Look, slope: Floats, behind: Linear, rough: Variances) -> Variances:
    """Return what a Kalman filter says of the sizes that the spectra of blocks suggest."""
    error, use = look.errors[0], look.use[0]
    return Variances(*through(np.where(use, error, 0.0), use, slope, behind, look.records[0].dt, rough.share / rough.base))


def _blocks(look: Look, slopes: tuple[Floats, ...], behind: Chain) -> Iterator[tuple[Floats, Floats]]:
    """Yield the spectrum of every whole block of residual, real and imaginary parts, and the shape of its variance."""
    for record, error, use, steep in zip(look.records, look.errors, look.use, slopes, strict=True):
        pulse = np.zeros(BLOCK)
        pulse[0] = 1.0
        shape = np.abs(np.fft.rfft(behind(pulse, record.dt, "zoh"), 2 * BLOCK)[2:-1:2]) ** 2
        for start in range(0, len(record) - BLOCK, BLOCK):
            part = slice(start, start + BLOCK)
            if use[part].all():
                e = np.fft.rfft(error[part])[1:-1] * np.sqrt(2 / BLOCK)
                yield np.concatenate([e.real, e.imag]), np.tile(shape * np.mean(steep[part] ** 2), 2)
