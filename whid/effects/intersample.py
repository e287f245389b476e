"""Between samples something else happens than declared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from whid.blocks._block import Block
from whid.blocks.intersample import Intersample as Course
from whid.blocks.linear import Linear
from whid.blocks.oversampled import Oversampled
from whid.effects._candidate import Candidate
from whid.effects._effect import Effect, Place
from whid.effects._look import Look
from whid.effects._sites import Sites, instant

FACTOR = 2  # times the record's rate at which a curve between sampled filters acts
BAND = 0.8  # of half the sampling rate, where the faster filter is to agree with the slower
LINES = 200
LEAST = 0.3  # of the largest gain: what is smaller need not agree better


@dataclass(frozen=True, kw_only=True)
class Intersample(Effect):
    """The input runs straight between its samples where it was declared held, or the other way round; or a curve between
    sampled filters acts between the samples as well, so that its harmonics do not fold back at half the sampling rate.

    The signature of the first is that of half a sample's delay, and it is looked for before everything else; that of the
    second lives where the curve's harmonics pass half the sampling rate.
    """

    places: ClassVar[tuple[Place, ...]] = ("time",)
    within: ClassVar[bool] = True

    def candidates(self, look: Look, sites: Sites) -> Iterator[Candidate]:
        """Yield the courses that were not declared, and the same model at twice the rate."""
        declared = look.records[0].intersample
        if declared == "discrete" or sites.blocks[0].kind == "intersample":
            return
        sampled = [block for block in sites.blocks if isinstance(block, Linear) and block.dt is not None]
        if sampled:
            yield from _faster(look, sites)
            return
        for between in ("zoh", "foh", "bandlimited"):
            if between != declared:
                yield sites.inserted(0, Course(between=between)).candidate()


def _faster(look: Look, sites: Sites) -> Iterator[Candidate]:
    """Yield the chain of sampled filters and static curves at FACTOR times the record's rate."""
    plain = all(instant(b) or (isinstance(b, Linear) and b.dt is not None and b.num) for b in sites.blocks)
    if not plain or not sites.nonlinear or sites.system.series_path != "chain.":
        return
    tones = sites.system.chain[len(sites.blocks) :]
    inner = tuple(_at_rate(block, float(look.records[0].dt) / FACTOR) for block in sites.blocks)
    system = replace(sites.system, chain=(Oversampled(factor=FACTOR, chain=inner), *tones))
    yield Candidate(system, sites.core, ())


def _at_rate(block: Block, dt: float) -> Block:
    """Return a sampled filter at another rate: its poles moved, its numerator by least squares on its frequency response."""
    if not isinstance(block, Linear) or block.dt is None:
        return block
    omega = np.pi / block.dt * BAND * (np.arange(LINES) + 0.5) / LINES
    wanted = block.gain_at(omega)
    poles = np.roots(block.transfer_function()[1]).astype(complex) ** (dt / block.dt)
    den = np.real(np.atleast_1d(np.poly(poles)))
    order = len(block.transfer_function()[0]) - 1
    z = np.exp(1j * omega * dt)
    rows = z[:, None] ** np.arange(order, -1, -1.0) / np.polyval(den, z)[:, None]
    weight = 1 / (np.abs(wanted) + LEAST * np.abs(wanted).max())
    stacked = np.concatenate([(rows * weight[:, None]).real, (rows * weight[:, None]).imag])
    num = np.linalg.lstsq(stacked, np.concatenate([(wanted * weight).real, (wanted * weight).imag]), rcond=None)[0]
    return replace(block, num=tuple(map(float, num)), den=tuple(map(float, den)), dt=dt)
